"""A transducer behind a serial line, or a network connection."""

import time

import numpy as np

from usmap_ros.drivers.frames import TRIGGER, FrameReader, SampleFrame
from usmap_ros.drivers.ping_source import NoAnswerError
from usmap_ros.drivers.port import Port
from usmap_ros.errors import MalformedMessageError
from usmap_ros.importing import Sensor
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import EchoTrace


class SerialTransducer:
    """A device that answers each trigger with a frame of samples; a `PingSource`.

    Parameters
    ----------
    port : Port
        Where it is.
    sensor : Sensor
        What its samples are.
    answer_timeout_s : float
        Longest time from the trigger to the end of the frame.
    """

    def __init__(self, port: Port, sensor: Sensor, answer_timeout_s: float) -> None:
        self._port = port
        self._sensor = sensor
        self._timeout_s = answer_timeout_s
        self._reader = FrameReader()
        self._number = 0

    def open(self) -> None:
        """Open the port."""
        self._port.open()

    def close(self) -> None:
        """Close the port."""
        self._port.close()

    def ping(self, stamp_ns: int, base: Pose) -> list[EchoTrace]:
        """Trigger the device, and wait for its frame."""
        self._number = (self._number + 1) % 256
        self._reader.clear()
        self._port.write(TRIGGER + bytes([self._number]))
        frame = self._answer()
        samples = frame.samples.astype(np.float64)
        return [self._sensor.trace(samples, stamp_ns, self._sensor.pose(base))]

    def _answer(self) -> SampleFrame:
        """The frame that answers the last trigger; those of earlier ones came too late."""
        deadline_s = time.monotonic() + self._timeout_s
        heard = 0
        while True:
            data = self._port.read(deadline_s - time.monotonic())
            if not data:
                said = f"{heard} bytes, which are no frame: baud_rate?" if heard else "nothing"
                raise NoAnswerError(
                    f"{self._port.address}: within {self._timeout_s:g} s came {said}"
                )
            heard += len(data)
            for found in self._reader.feed(data):
                if isinstance(found, MalformedMessageError):
                    raise found
                if found.number == self._number:
                    return found
