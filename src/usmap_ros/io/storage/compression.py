"""Decompression that makes do with the beginning of the data, and knows when it is enough."""

from collections.abc import Iterator

import lz4.frame
import zstandard

from usmap_ros.bounds import LEAST_UNPACKED_BYTES, MAX_CHUNK_BYTES, MAX_UNPACKED_RATIO

#: What `decompress` may raise on corrupt data.
DECOMPRESSION_ERRORS = (zstandard.ZstdError, RuntimeError, ValueError)

FORMATS = ("", "lz4", "zstd")

_PIECE_BYTES = 2**22


class TooMuchError(ValueError):
    """Few bytes that stand for very many."""


class Allowance:
    """What the chunks and messages of one recording may unpack to, all together.

    Parameters
    ----------
    packed_bytes : int
        Size of the recording.
    """

    def __init__(self, packed_bytes: int) -> None:
        self.left_bytes = max(LEAST_UNPACKED_BYTES, MAX_UNPACKED_RATIO * packed_bytes)

    def take(self, size: int) -> None:
        """Use some of it up.

        Raises
        ------
        TooMuchError
            If there is not as much.
        """
        if size > self.left_bytes:
            raise TooMuchError("unpacks to more than is believed")
        self.left_bytes -= size


def decompress(
    data: bytes | memoryview, compression: str, allowance: Allowance | None = None
) -> bytes:
    """Decompress as much as `data` holds: all of it, or what comes before a cut.

    Parameters
    ----------
    data : bytes-like
        One frame, or its beginning.
    compression : str
        One of `FORMATS`; nothing is done for "".
    allowance : Allowance, optional
        Of the recording that it is from; what was scanned with one can be read again without.

    Raises
    ------
    TooMuchError
        If it is more than `MAX_CHUNK_BYTES`, or than is allowed.
    """
    if compression not in ("lz4", "zstd"):
        return bytes(data)
    most = MAX_CHUNK_BYTES
    if allowance is not None:
        most = min(most, allowance.left_bytes)
    pieces, size = [], 0
    for piece in _lz4_pieces(data) if compression == "lz4" else _zstd_pieces(data):
        pieces.append(piece)
        size += len(piece)
        if size > most:
            raise TooMuchError("unpacks to more than is believed")
    if allowance is not None:
        allowance.take(size)
    return b"".join(pieces)


def _lz4_pieces(data: bytes | memoryview) -> Iterator[bytes]:
    # In pieces: room for the longest result would be taken at once.
    decompressor = lz4.frame.LZ4FrameDecompressor()
    yield decompressor.decompress(data, max_length=_PIECE_BYTES)
    while not decompressor.eof and not decompressor.needs_input:
        yield decompressor.decompress(b"", max_length=_PIECE_BYTES)


def _zstd_pieces(data: bytes | memoryview) -> Iterator[bytes]:
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        while piece := reader.read(_PIECE_BYTES):
            yield piece
