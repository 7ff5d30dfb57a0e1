"""Decompression that makes do with the beginning of the data."""

from __future__ import annotations

import lz4.frame
import zstandard

#: What `decompress` may raise on corrupt data.
DECOMPRESSION_ERRORS = (zstandard.ZstdError, RuntimeError, ValueError)

FORMATS = ("", "lz4", "zstd")


#: Most that one chunk or message is unpacked to: a few bytes can stand for very many.
MAX_CONTENT_BYTES = 2**30
_PIECE_BYTES = 2**22


def decompress(data: bytes | memoryview, compression: str) -> bytes:
    """Decompress as much as `data` holds: all of it, or what comes before a cut.

    Parameters
    ----------
    data : bytes-like
        One frame, or its beginning.
    compression : str
        One of `FORMATS`; nothing is done for "".

    Raises
    ------
    ValueError
        If it is more than `MAX_CONTENT_BYTES`.
    """
    if compression == "lz4":
        return _decompress_lz4(data)
    if compression == "zstd":
        return _decompress_zstd(data)
    return bytes(data)


def _decompress_lz4(data: bytes | memoryview) -> bytes:
    # In pieces: room for the longest result would be taken at once.
    decompressor = lz4.frame.LZ4FrameDecompressor()
    pieces = [decompressor.decompress(data, max_length=_PIECE_BYTES)]
    size = len(pieces[0])
    while not decompressor.eof and not decompressor.needs_input:
        pieces.append(decompressor.decompress(b"", max_length=_PIECE_BYTES))
        size += len(pieces[-1])
        if size > MAX_CONTENT_BYTES:
            raise ValueError("unpacks to more than is believed")
    return b"".join(pieces)


def _decompress_zstd(data: bytes | memoryview) -> bytes:
    pieces, size = [], 0
    with zstandard.ZstdDecompressor().stream_reader(data) as reader:
        while piece := reader.read(_PIECE_BYTES):
            pieces.append(piece)
            size += len(piece)
            if size > MAX_CONTENT_BYTES:
                raise ValueError("unpacks to more than is believed")
    return b"".join(pieces)
