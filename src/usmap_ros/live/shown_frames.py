"""Where robots' frames are shown in the map: they move smoothly, and jump only where they must."""

from collections.abc import Mapping

import numpy as np

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import wrapped

#: How fast a frame moves, m/s and rad/s; and how far it has to be off to jump, m and rad.
SPEED_M_S, TURN_RAD_S = 0.2, 0.1
JUMP_M, JUMP_RAD = 0.5, 0.25


class ShownFrames:
    """Frames of odometry in the map's frame, as x, y (m) and yaw (rad)."""

    def __init__(self) -> None:
        #: Where each frame is shown.
        self.shown: dict[str, FloatArray] = {}
        self._targets: dict[str, FloatArray] = {}

    def aim(self, targets: Mapping[str, FloatArray]) -> list[str]:
        """Say where frames are by now; which of them jump there, since they are too far off.

        Frames that are not among them are shown no more.
        """
        self._targets = {name: np.array(target) for name, target in targets.items()}
        self.shown = {name: at for name, at in self.shown.items() if name in targets}
        jumped = []
        for name, target in self._targets.items():
            off = self._off(name)
            if off is None:
                self.shown[name] = target.copy()
            elif np.hypot(off[0], off[1]) > JUMP_M or abs(off[2]) > JUMP_RAD:
                self.shown[name] = target.copy()
                jumped.append(name)
        return jumped

    def step(self, seconds: float) -> None:
        """Let all frames move for some time towards where they are."""
        most = np.array([SPEED_M_S, TURN_RAD_S]) * seconds
        for name, at in list(self.shown.items()):
            off = self._targets[name] - at
            off[2] = wrapped(off[2])
            far = max(float(np.hypot(off[0], off[1])) / most[0], abs(float(off[2])) / most[1])
            self.shown[name] = at + off / max(far, 1.0)

    def _off(self, name: str) -> FloatArray | None:
        """How far a frame has to go; None if it is not shown yet."""
        if name not in self.shown:
            return None
        off = self._targets[name] - self.shown[name]
        off[2] = wrapped(off[2])
        return np.asarray(off)
