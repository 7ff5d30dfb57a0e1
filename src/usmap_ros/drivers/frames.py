"""How a microcontroller answers over a serial line: one frame a ping.

All numbers are little-endian.  A driver asks for a ping with `TRIGGER` and a number of one byte.
The device answers with a frame: a header, samples, and the CRC-32 of both (that of zlib and
Ethernet).  The header is `MAGIC`, the number of the trigger that is answered, the type of the
samples (`SAMPLE_TYPES`), and how many there are in two bytes.  What comes between frames is
skipped.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import MalformedMessageError

#: What asks for a ping, before its number.
TRIGGER = b"P"
#: What a frame begins with: the last character is the version.
MAGIC = b"USM1"
#: Types of samples by their numbers.
SAMPLE_TYPES: dict[int, np.dtype[Any]] = {
    0: np.dtype("<i2"),
    1: np.dtype("<u2"),
    2: np.dtype("<f4"),
}
_HEADER = struct.Struct("<4sBBH")
_CHECKSUM = struct.Struct("<I")


@dataclass(frozen=True)
class SampleFrame:
    """An answer to a trigger."""

    #: That of the trigger, 0 to 255.
    number: int
    #: (n,) array: as the device counts them.
    samples: NDArray[Any]

    def packed(self) -> bytes:
        """As the device sends it: what firmware has to do, and what plays a device in tests."""
        (kind,) = (kind for kind, dtype in SAMPLE_TYPES.items() if dtype == self.samples.dtype)
        header = _HEADER.pack(MAGIC, self.number, kind, len(self.samples))
        content = header + self.samples.tobytes()
        return content + _CHECKSUM.pack(zlib.crc32(content))


class FrameReader:
    """Finds frames in what comes over a line, in pieces of any length."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def clear(self) -> None:
        """Forget what has come of a frame."""
        self._waiting.clear()

    def feed(self, data: bytes) -> Iterator[SampleFrame | MalformedMessageError]:
        """Take what has come; yield the frames that are complete, and what is wrong with others."""
        self._waiting += data
        while self._find_header():
            _, number, kind, count = _HEADER.unpack_from(self._waiting)
            dtype = SAMPLE_TYPES.get(kind)
            if dtype is None:
                yield self._refused("type", f"is {kind}, must be one of {[*SAMPLE_TYPES]}")
                continue
            length = _HEADER.size + count * dtype.itemsize
            if len(self._waiting) < length + _CHECKSUM.size:
                return
            content = bytes(self._waiting[:length])
            if _CHECKSUM.unpack_from(self._waiting, length)[0] != zlib.crc32(content):
                yield self._refused("checksum", "is wrong: bytes were lost or damaged on the line")
                continue
            del self._waiting[: length + _CHECKSUM.size]
            yield SampleFrame(number, np.frombuffer(content, dtype, count, _HEADER.size))

    def _find_header(self) -> bool:
        """Drop what is before the next header; whether it is there as a whole."""
        start = self._waiting.find(MAGIC)
        # Without one, its first bytes may have come.
        del self._waiting[: start if start >= 0 else max(0, len(self._waiting) - len(MAGIC) + 1)]
        return start >= 0 and len(self._waiting) >= _HEADER.size

    def _refused(self, field: str, cause: str) -> MalformedMessageError:
        """What is wrong with the frame at hand, behind whose first bytes the search goes on."""
        del self._waiting[: len(MAGIC)]
        return MalformedMessageError(f"frame.{field}", cause)
