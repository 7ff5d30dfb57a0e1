"""Whether a ping is new: the same evidence must not count twice.

Two reconstructors of one robot, a recording that is played again, the same bag given twice: the
same ping comes as several cones.
"""

from __future__ import annotations

import zlib
from array import array
from bisect import bisect_left

from usmap_ros.errors import MalformedMessageError
from usmap_ros.pings.cone import EchoCone

#: Pings remembered of each transducer: of one that pings ten times a second, those of a day.
_PINGS = 1_000_000
#: Transducers remembered.
_TRANSDUCERS = 1_000


class RepeatedPingError(MalformedMessageError):
    """A ping that was there before."""


class SeenPings:
    """Remembers pings, at 12 bytes each.

    A ping is the same as another if stamp, transducer, pulse and reported pose are: robots whose
    frames are named alike may well ping at one instant, but not from one place.
    """

    def __init__(self) -> None:
        # By the transducer's frame: stamps, ascending, and beside each a checksum of the rest.
        self._seen: dict[str, tuple[array[int], array[int]]] = {}

    def add(self, cone: EchoCone) -> None:
        """Remember a ping.

        Raises
        ------
        RepeatedPingError
            If it was there before.
        """
        stamps, sums = self._of_transducer(cone.child_frame_id)
        checksum = _checksum(cone)
        place = bisect_left(stamps, cone.stamp_ns)
        while place < len(stamps) and stamps[place] == cone.stamp_ns:
            if sums[place] == checksum:
                raise RepeatedPingError(
                    "header.stamp", f"is that of an earlier ping of '{cone.child_frame_id}'"
                )
            place += 1
        stamps.insert(place, cone.stamp_ns)
        sums.insert(place, checksum)
        if len(stamps) > _PINGS:
            # Half of them at once: moving all for each new one would take long.
            del stamps[: _PINGS // 2], sums[: _PINGS // 2]

    def _of_transducer(self, frame_id: str) -> tuple[array[int], array[int]]:
        if frame_id not in self._seen and len(self._seen) >= _TRANSDUCERS:
            del self._seen[next(iter(self._seen))]
        return self._seen.setdefault(frame_id, (array("q"), array("I")))


def _checksum(cone: EchoCone) -> int:
    """Of all that tells pings of one stamp apart, as the robot stated it."""
    pose = cone.pose.position_m.tobytes() + cone.pose.orientation.tobytes()
    return zlib.crc32(repr(cone.transducer.pulse).encode(), zlib.crc32(pose))
