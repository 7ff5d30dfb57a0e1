"""A transducer behind a serial line, played by a thread at the other end of a pseudo-terminal."""

import os
import select
import threading
import tty
from collections.abc import Callable
from pathlib import Path

import numpy as np

from usmap_ros.drivers.frames import TRIGGER, SampleFrame

Answer = Callable[[int], bytes]
SENSOR = """
robot: robot1
samples: {encoding: raw, sample_rate_hz: 200000.0, full_scale: 1000.0}
poses: {position_std_m: 0.01, mount: {x_m: 0.1, z_m: 0.2}}
pulse: {shape: tone_burst, carrier_hz: 40000.0, duration_s: 0.0002}
beam: {kind: linear, half_angle_rad: 0.6}
min_range_m: 0.2
max_range_m: 3.0
"""


def counts(number: int) -> np.ndarray:
    """What the device counts after a trigger: every ping is another one."""
    return (np.arange(3600) % 500 - 250 + number).astype("<i2")


def frame(number: int) -> bytes:
    """Answer as a device does that works."""
    return SampleFrame(number, counts(number)).packed()


class PlayedDevice:
    """A device at `path`, a link to a pseudo-terminal, that answers triggers.

    Attributes
    ----------
    answer : callable
        What it sends, for the number of a trigger; may be exchanged.
    """

    def __init__(self, path: Path, answer: Answer = frame) -> None:
        self.path = path
        self.answer = answer
        self._plugged: tuple[int, int] | None = None
        self._is_ending = False
        self._thread = threading.Thread(target=self._play, daemon=True)
        self.plug_in()
        self._thread.start()

    def plug_in(self) -> None:
        """Let it be there."""
        ours, theirs = os.openpty()
        tty.setraw(theirs)
        self.path.symlink_to(os.ttyname(theirs))
        self._plugged = (ours, theirs)

    def pull_out(self) -> None:
        """Let it be gone."""
        ends, self._plugged = self._plugged, None
        self.path.unlink()
        for end in ends or ():
            os.close(end)

    def end(self) -> None:
        """Let it be gone for good."""
        self._is_ending = True
        self._thread.join()
        if self._plugged:
            self.pull_out()

    def _play(self) -> None:
        asked = b""
        while not self._is_ending:
            plugged = self._plugged
            if plugged is None:
                threading.Event().wait(0.01)
                continue
            try:
                if select.select([plugged[0]], [], [], 0.02)[0]:
                    asked += os.read(plugged[0], 100)
                while len(asked) >= 2:
                    assert asked[:1] == TRIGGER
                    self._send(plugged[0], self.answer(asked[1]))
                    asked = asked[2:]
            except OSError:
                asked = b""  # It is being pulled out.

    @staticmethod
    def _send(end: int, data: bytes) -> None:
        while data:
            data = data[os.write(end, data) :]
