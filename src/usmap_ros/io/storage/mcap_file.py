"""MCAP files: their messages, as `usmap_ros.io.storage.mcap_scan` has found them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Container, Iterable
from pathlib import Path
from typing import BinaryIO

from usmap_ros.io.storage.compression import decompress
from usmap_ros.io.storage.index import FileOfRecording, MessageIndex
from usmap_ros.io.storage.mcap_scan import IN_FILE, Chunk, McapScan

_CACHED_CHUNK_BYTES = 16 * 2**20


class McapFile(FileOfRecording):
    """Storage of one MCAP file; see `usmap_ros.io.storage.index.Storage`.

    Parameters are those of `usmap_ros.io.storage.index.FileOfRecording`.
    """

    def __init__(self, path: Path, shown_path: Path | None = None, compression: str = "") -> None:
        super().__init__(path, shown_path, compression)
        self._file: BinaryIO | None = None
        self._chunks: dict[int, Chunk] = {}
        self._chunk_cache: OrderedDict[int, bytes] = OrderedDict()

    def scan(self, wanted: Container[str]) -> MessageIndex:
        """Walk through the file and note the `wanted` messages."""
        with self._file_path.open("rb") as file:
            scan = McapScan(self.path, file, wanted, self._compression)
            scan.run()
        self._chunks = dict(enumerate(scan.chunks))
        return scan.index

    def payload(self, block: int, offset: int, size: int) -> memoryview:
        """Fetch a serialized message from the file or from its chunk."""
        if block == IN_FILE:
            payload = memoryview(self._read(offset, size))
        else:
            payload = memoryview(self._chunk_content(block))[offset : offset + size]
        return memoryview(decompress(payload, self._compression)) if self._compression else payload

    def part(self, blocks: Iterable[int]) -> McapFile:
        """The same file, of which only some chunks are known."""
        part = McapFile(self._file_path, self.path, self._compression)
        part._chunks = {block: self._chunks[block] for block in blocks if block != IN_FILE}
        return part

    def close(self) -> None:
        """Let go of the file and of cached chunks."""
        self._chunk_cache.clear()
        if self._file is not None:
            self._file.close()
            self._file = None

    def _read(self, position: int, size: int) -> bytes:
        if self._file is None:
            self._file = self._file_path.open("rb")
        self._file.seek(position)
        return self._file.read(size)

    def _chunk_content(self, block: int) -> bytes:
        content = self._chunk_cache.pop(block, None)
        if content is None:
            chunk = self._chunks[block]
            content = decompress(self._read(chunk.position, chunk.size), chunk.compression)
        self._chunk_cache[block] = content
        cached = sum(map(len, self._chunk_cache.values()))
        while cached > _CACHED_CHUNK_BYTES and len(self._chunk_cache) > 1:
            _, dropped = self._chunk_cache.popitem(last=False)
            cached -= len(dropped)
        return content
