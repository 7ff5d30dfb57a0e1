"""Decompression that makes do with the beginning of the data."""

from __future__ import annotations

import lz4.frame
import zstandard

#: What `decompress` may raise on corrupt data.
DECOMPRESSION_ERRORS = (zstandard.ZstdError, RuntimeError, ValueError)

FORMATS = ("", "lz4", "zstd")


def decompress(data: bytes | memoryview, compression: str) -> bytes:
    """Decompress as much as `data` holds: all of it, or what comes before a cut.

    Parameters
    ----------
    data : bytes-like
        One frame, or its beginning.
    compression : str
        One of `FORMATS`; nothing is done for "".
    """
    if compression == "lz4":
        content: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data)
        return content
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    return bytes(data)
