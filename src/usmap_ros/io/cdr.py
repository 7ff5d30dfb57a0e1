"""Bytes of messages field by field: CDR, as all of ROS 2 Jazzy writes it.

Each number lies at a multiple of its size, counted from behind the four bytes that every message
begins with; the second of these tells the byte order.  Texts and sequences begin with their length,
that of a text counts the zero at its end.  (OMG, "DDS Interoperability Wire Protocol", 10.2.)

A library would read the same.  A trace is read and checked in 19 µs; rclpy takes 31 µs to make a
message of the bytes that still is to be checked and turned into a trace, and rosbags 10 µs, after
97 ms to learn the types, which every command and worker would wait for (``python
benchmarks/own_code.py``).
"""

from __future__ import annotations

import struct
import sys
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usmap_ros.errors import MalformedMessageError

Payload = bytes | memoryview

_HEAD = b"\x00\x01\x00\x00"
#: A middleware may fill up a message to the next multiple of four.
_MOST_PADDING = 3
_IS_LITTLE_HERE = sys.byteorder == "little"


class Layout(NamedTuple):
    """Numbers that follow one another, in either byte order."""

    #: Size of the first number, bytes.
    alignment: int
    #: How they are packed.
    little: struct.Struct
    big: struct.Struct

    @classmethod
    def of(cls, alignment: int, pattern: str) -> Layout:
        """Layout of a pattern of `struct`, whose own padding has to be written out."""
        return cls(alignment, struct.Struct("<" + pattern), struct.Struct(">" + pattern))


BYTE = Layout.of(1, "B")
FLOAT = Layout.of(4, "f")
COUNT = Layout.of(4, "I")


class CdrReader:
    """Reads the fields of one message in their order.

    Parameters
    ----------
    payload : bytes or memoryview
        The message; arrays are views of it where the byte order allows.

    Raises
    ------
    MalformedMessageError
        If it does not begin like a message; and so do all methods where it ends too early.
    """

    __slots__ = ("_at", "_is_little", "_payload")

    def __init__(self, payload: Payload) -> None:
        if len(payload) < len(_HEAD) or payload[0] != 0 or payload[1] > 1:
            raise MalformedMessageError("message", "cannot be decoded: it does not begin as CDR")
        self._payload = payload
        self._at = len(_HEAD)
        self._is_little = payload[1] == 1

    def numbers(self, layout: Layout) -> tuple[Any, ...]:
        """Numbers as they lie in a layout."""
        packed = layout.little if self._is_little else layout.big
        return packed.unpack_from(self._payload, self._claim(layout.alignment, packed.size))

    def text(self) -> str:
        """Text."""
        (length,) = self.numbers(COUNT)
        at = self._claim(1, length)
        try:
            return str(self._payload[at : at + max(length - 1, 0)], "utf-8")
        except UnicodeDecodeError as error:
            cause = "cannot be decoded: a text in it is not UTF-8"
            raise MalformedMessageError("message", cause) from error

    def sequence(self, kind: np.dtype[Any]) -> NDArray[Any]:
        """Numbers of one kind, however many there are."""
        (length,) = self.numbers(COUNT)
        return self.array(kind, length)

    def array(self, kind: np.dtype[Any], length: int) -> NDArray[Any]:
        """Numbers of one kind, of which it is known how many there are."""
        # Where there is nothing, nothing is aligned.
        if not length:
            return np.zeros(0, kind)
        at = self._claim(kind.itemsize, length * kind.itemsize)
        found: NDArray[Any] = np.frombuffer(self._payload, kind, length, at)
        return found if self._is_little is _IS_LITTLE_HERE else found.byteswap()

    def end(self) -> None:
        """Refuse a message that goes on."""
        if len(self._payload) - self._at > _MOST_PADDING:
            raise MalformedMessageError(
                "message", f"cannot be decoded: it goes on after its {self._at} bytes"
            )

    def _claim(self, alignment: int, size: int) -> int:
        """Where the next `size` bytes begin."""
        at = self._at + (len(_HEAD) - self._at) % alignment
        self._at = at + size
        if self._at > len(self._payload):
            raise MalformedMessageError(
                "message", f"cannot be decoded: it ends after {len(self._payload)} bytes"
            )
        return at


class CdrWriter:
    """Writes the fields of one message in their order."""

    __slots__ = ("_content",)

    def __init__(self) -> None:
        self._content = bytearray(_HEAD)

    def numbers(self, layout: Layout, *values: float) -> None:
        """Append numbers as they lie in a layout."""
        self._align(layout.alignment)
        self._content += layout.little.pack(*values)

    def text(self, text: str) -> None:
        """Append a text."""
        encoded = text.encode()
        self.numbers(COUNT, len(encoded) + 1)
        self._content += encoded
        self._content.append(0)

    def sequence(self, kind: np.dtype[Any], values: ArrayLike) -> None:
        """Append numbers of one kind, and before them how many there are."""
        array = np.asarray(values, kind)
        self.numbers(COUNT, array.size)
        if array.size:
            self.array(kind, array)

    def array(self, kind: np.dtype[Any], values: ArrayLike) -> None:
        """Append numbers of one kind, of which a reader knows how many there are."""
        self._align(kind.itemsize)
        array = np.asarray(values, kind)
        self._content += (array if _IS_LITTLE_HERE else array.byteswap()).tobytes()

    def message(self) -> bytes:
        """Return the message."""
        return bytes(self._content)

    def _align(self, alignment: int) -> None:
        self._content += bytes((len(_HEAD) - len(self._content)) % alignment)
