"""The interface between a driver and what it pings with."""

from collections.abc import Sequence
from typing import Protocol

from usmap_ros.errors import UsmapError
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import EchoTrace


class DeviceError(UsmapError):
    """A device that is not there, or not any more: it has to be opened again."""


class NoAnswerError(DeviceError):
    """A ping that a device did not answer in time; the next one it may."""


class PingSource(Protocol):
    """One transducer, or several that ping at once: real, simulated, or anything else.

    A driver opens it, lets it ping whenever it is its turn, and closes it at the end, or to open
    it again.  It may be opened in another thread than the one that made it.
    """

    def open(self) -> None:
        """Get ready to ping.

        Raises
        ------
        DeviceError
            If the device is not there.
        """
        ...

    def ping(self, stamp_ns: int, base: Pose) -> Sequence[EchoTrace]:
        """Ping, and listen until the last echo has come.

        Parameters
        ----------
        stamp_ns : int
            Now, when the emission starts; nanoseconds since the epoch.
        base : Pose
            Of the robot's base frame in the world.

        Returns
        -------
        sequence of EchoTrace
            Of each transducer that listened.

        Raises
        ------
        MalformedMessageError
            If what the device said cannot be true.
        NoAnswerError
            If it said nothing in time.
        DeviceError
            If it is gone.
        """
        ...

    def close(self) -> None:
        """Let go of the device; nothing if it is not open."""
        ...
