"""A simulated robot on TF: its base in the world, its transducers on its base."""

from __future__ import annotations

from collections.abc import Mapping

from usmap_ros.nodes.plumbing.frames import Transforms
from usmap_ros.numerics.geometry import Pose


class RobotFrames:
    """Broadcasts the frames of a robot, each below one parent.

    Parameters
    ----------
    transforms : Transforms
        TF; without it nothing is broadcast.
    world, base_frame : str
        Frames of the scenario and of the robot.
    mounts : mapping of str to Pose
        Of each transducer's frame in the robot's: broadcast once, for good.
    has_base : bool
        Whether the robot's base is broadcast too.
    """

    def __init__(
        self,
        transforms: Transforms,
        world: str,
        base_frame: str,
        mounts: Mapping[str, Pose],
        has_base: bool,
    ) -> None:
        self._transforms = transforms
        self._world = world
        self._base_frame = base_frame
        self._has_base = has_base
        transforms.broadcast_for_good(base_frame, mounts)

    def move(self, base: Pose, stamp_ns: int) -> None:
        """Say where the robot truly is."""
        if self._has_base:
            self._transforms.broadcast(base, self._world, self._base_frame, stamp_ns)
