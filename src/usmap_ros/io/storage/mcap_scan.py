"""A walk through an MCAP file, up to a cut or a checksum that does not match.

mcap's own streaming reader drops the chunk in which a file was cut off, with everything in it.
A recorder's chunks hold a megabyte or more, which is many pings, so the chunk's messages up to
the cut are read here too.
"""

from __future__ import annotations

import io
import logging
import struct
import zlib
from collections.abc import Container, Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel as ChannelRecord
from mcap.records import Schema as SchemaRecord

from usmap_ros.bounds import LEAST_RECORD_BYTES, LEAST_RECORDS, MAX_CHUNK_BYTES
from usmap_ros.errors import BagError
from usmap_ros.io.storage.compression import (
    DECOMPRESSION_ERRORS,
    FORMATS,
    Allowance,
    TooMuchError,
    decompress,
)
from usmap_ros.io.storage.index import (
    Damage,
    MessageIndex,
    RecordedTopic,
    header_stamp_ns,
)

logger = logging.getLogger(__name__)

MAGIC = b"\x89MCAP0\r\n"

_RECORD_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQII")
_LENGTH = struct.Struct("<Q")
_READ = (Opcode.CHUNK, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
#: Block number of messages that lie in the file uncompressed.
IN_FILE = -1


class _CorruptError(Exception):
    """What lies at `position` cannot be right; reading ends here."""

    def __init__(self, cause: str, position: int) -> None:
        super().__init__(cause)
        self.position = position


class Chunk(NamedTuple):
    """Where a compressed chunk lies in the file."""

    position: int
    size: int
    compression: str


class McapScan:
    """One walk through an MCAP file."""

    def __init__(
        self, path: Path, file: BinaryIO, wanted: Container[str], compression: str
    ) -> None:
        self.index = MessageIndex()
        self.chunks: list[Chunk] = []
        self._path = path
        self._file = file
        self._wanted = wanted
        self._compression = compression
        self._total_bytes = file.seek(0, io.SEEK_END)
        self._most_records = max(LEAST_RECORDS, self._total_bytes // LEAST_RECORD_BYTES)
        self._schemas: dict[int, SchemaRecord] = {}
        self._topic_numbers: dict[int, int] = {}
        self._unchecked = 0
        self._allowance = Allowance(self._total_bytes)

    def run(self) -> None:
        """Fill `index` and `chunks`."""
        self._file.seek(0)
        magic = self._file.read(len(MAGIC))
        if not magic:
            raise BagError(self._path, "is empty")
        if not MAGIC.startswith(magic):
            raise BagError(self._path, "is not an MCAP file")
        try:
            self._read_records()
            if self._unchecked:
                logger.info(
                    "%s: %d chunks carry no checksum: damage in them goes unseen",
                    self._path, self._unchecked,
                )  # fmt: skip
        except _CorruptError as error:
            self.index.damage = Damage(str(error), error.position, self._total_bytes)

    def _read_records(self) -> None:
        position = len(MAGIC)
        while True:
            self._file.seek(position)
            head = self._file.read(_RECORD_HEAD.size)
            if len(head) < _RECORD_HEAD.size:
                raise _CorruptError("is cut off", position)
            opcode, size = _RECORD_HEAD.unpack(head)
            body_position = position + _RECORD_HEAD.size
            if opcode == Opcode.DATA_END:
                self._check_end(position)
                return
            self._read_record(opcode, body_position, size)
            if body_position + size > self._total_bytes:
                raise _CorruptError("is cut off", position)
            position = body_position + size

    def _check_end(self, position: int) -> None:
        """Note if the end is missing; the summary, which comes before it, is not read."""
        self._file.seek(max(position, self._total_bytes - len(MAGIC)))
        if self._file.read() != MAGIC:
            raise _CorruptError("is cut off behind its last message", position)

    def _read_record(self, opcode: int, position: int, size: int) -> None:
        """Read a record outside of chunks, or a chunk; other kinds hold no messages."""
        if opcode in _READ and min(size, self._total_bytes - position) > MAX_CHUNK_BYTES:
            raise _CorruptError("has a record larger than is believed", position)
        if opcode == Opcode.CHUNK:
            self._read_chunk(position, size)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            body = self._file.read(min(size, self._total_bytes - position))
            if len(body) == size:
                self._note(opcode, memoryview(body), IN_FILE, position, position)

    def _read_chunk(self, position: int, size: int) -> None:
        """Read a chunk, or what is there of it."""
        body = memoryview(self._file.read(min(size, self._total_bytes - position)))
        whole = len(body) == size
        try:
            _, _, content_size, checksum, name_size = _CHUNK_HEAD.unpack_from(body)
            compression = bytes(body[_CHUNK_HEAD.size :][:name_size]).decode()
            start = _CHUNK_HEAD.size + name_size
            (stored_size,) = _LENGTH.unpack_from(body, start)
        except (struct.error, UnicodeDecodeError) as error:
            raise _CorruptError("is cut off" if not whole else "is corrupt", position) from error
        start += _LENGTH.size
        if compression not in FORMATS:
            raise _CorruptError(f"has a chunk with unknown compression {compression!r}", position)
        stored = body[start : start + stored_size]
        content = self._chunk_content(stored, compression, position)
        self._unchecked += checksum == 0
        if whole and (len(content) != content_size or _differs(content, checksum)):
            raise _CorruptError("has a chunk that fails its checksum", position)
        if compression:
            self.chunks.append(Chunk(position + start, len(stored), compression))
            block, base = len(self.chunks) - 1, 0
        else:
            block, base = IN_FILE, position + start
        self._note_all(content, block, base, position)
        if not whole:
            complete = max((stop for _, _, stop in _records_of(content)), default=0)
            raise _CorruptError("is cut off", position if compression else base + complete)

    def _chunk_content(self, stored: memoryview, compression: str, position: int) -> memoryview:
        if not compression:
            return stored
        try:
            return memoryview(decompress(stored, compression, self._allowance))
        except TooMuchError as error:
            raise _CorruptError(f"has a chunk that {error}", position) from error
        except DECOMPRESSION_ERRORS as error:
            raise _CorruptError("has a chunk that does not decompress", position) from error

    def _note_all(self, content: memoryview, block: int, base: int, position: int) -> None:
        number = 0
        for number, (opcode, start, stop) in enumerate(_records_of(content), start=1):
            if number > self._most_records:
                raise _CorruptError("has a chunk of more records than are believed", position)
            self._note(opcode, content[start:stop], block, base + start, position)
        self._most_records -= number

    def _note(self, opcode: int, body: memoryview, block: int, offset: int, position: int) -> None:
        """Note a record; `offset` is that of its body in the block, `position` that in the file."""
        try:
            if opcode == Opcode.SCHEMA:
                schema = SchemaRecord.read(ReadDataStream(io.BytesIO(body)))
                self._schemas[schema.id] = schema
            elif opcode == Opcode.CHANNEL:
                self._note_channel(ChannelRecord.read(ReadDataStream(io.BytesIO(body))))
            elif opcode == Opcode.MESSAGE:
                self._note_message(body, block, offset)
        except (McapError, struct.error, UnicodeDecodeError, *DECOMPRESSION_ERRORS) as error:
            raise _CorruptError("has a record that makes no sense", position) from error

    def _note_channel(self, record: ChannelRecord) -> None:
        if record.id in self._topic_numbers:
            return
        schema = self._schemas.get(record.schema_id)
        recorded = RecordedTopic(
            record.topic, schema.name if schema else "", encoding=record.message_encoding
        )
        if schema:
            recorded.definition = schema.data.decode()
            recorded.definition_format = schema.encoding
        recorded.offered_qos = record.metadata.get("offered_qos_profiles", "")
        self._topic_numbers[record.id] = len(self.index.topics)
        self.index.topics.append(recorded)

    def _note_message(self, body: memoryview, block: int, offset: int) -> None:
        channel_id, _, log_time_ns, _ = _MESSAGE_HEAD.unpack_from(body)
        number = self._topic_numbers.get(channel_id)
        if number is None:
            raise ValueError(f"message on channel {channel_id}, which was not declared")
        recorded = self.index.topics[number]
        recorded.count += 1
        if recorded.message_type not in self._wanted:
            return
        payload = body[_MESSAGE_HEAD.size :]
        if self._compression:
            payload = memoryview(decompress(payload, self._compression, self._allowance))
        stamp_ns = header_stamp_ns(payload, otherwise=log_time_ns)
        size = len(body) - _MESSAGE_HEAD.size
        self.index.append(number, stamp_ns, log_time_ns, block, offset + _MESSAGE_HEAD.size, size)


def _records_of(content: memoryview) -> Iterator[tuple[int, int, int]]:
    """Opcode, start and end of the body of every complete record in a chunk's content."""
    position = 0
    while position + _RECORD_HEAD.size <= len(content):
        opcode, size = _RECORD_HEAD.unpack_from(content, position)
        start = position + _RECORD_HEAD.size
        position = start + size
        if position > len(content):
            return
        yield opcode, start, position


def _differs(content: memoryview, checksum: int) -> bool:
    """Whether content fails its checksum; 0 stands for none."""
    return checksum != 0 and zlib.crc32(content) != checksum
