"""rosbag2's sqlite3 files, read in the order of recording and as far as the database is sound."""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Container, Iterable
from pathlib import Path

from usmap_ros.bounds import LEAST_SQLITE_STEPS, MAX_CHUNK_BYTES, MAX_SQLITE_STEPS_PER_BYTE
from usmap_ros.errors import BagError, shortened
from usmap_ros.io.storage.compression import DECOMPRESSION_ERRORS, Allowance, decompress
from usmap_ros.io.storage.index import (
    Damage,
    FileOfRecording,
    MessageIndex,
    RecordedTopic,
    header_stamp_ns,
)

MAGIC = b"SQLite format 3\x00"


class SqliteFile(FileOfRecording):
    """Storage of one sqlite3 file; see `usmap_ros.io.storage.index.Storage`.

    Parameters are those of `usmap_ros.io.storage.index.FileOfRecording`.
    """

    def __init__(self, path: Path, shown_path: Path | None = None, compression: str = "") -> None:
        super().__init__(path, shown_path, compression)
        self._connection: sqlite3.Connection | None = None

    def scan(self, wanted: Container[str]) -> MessageIndex:
        """Walk through the table of messages and note the `wanted` ones."""
        with self._file_path.open("rb") as file:
            magic = file.read(len(MAGIC))
        if not magic:
            raise BagError(self.path, "is empty")
        if magic != MAGIC:
            raise BagError(self.path, "is not an sqlite3 file")
        index = MessageIndex()
        kept_bytes, size = 0, self._file_path.stat().st_size
        allowance = Allowance(size)
        # Of a page that leads back to itself, or a table that is computed, there is no end.
        most_steps = max(LEAST_SQLITE_STEPS, MAX_SQLITE_STEPS_PER_BYTE * size)
        self._open().set_progress_handler(lambda: 1, most_steps)
        try:
            numbers = self._read_topics(index)
            for row, topic, log_time_ns, data in self._open().execute(
                "SELECT rowid, topic_id, timestamp, data FROM messages ORDER BY rowid"
            ):
                number = numbers[topic]
                recorded = index.topics[number]
                recorded.count += 1
                if recorded.message_type in wanted:
                    stamp_ns = header_stamp_ns(self._unpack(data, allowance), log_time_ns)
                    index.append(number, stamp_ns, log_time_ns, block=0, offset=row, size=0)
                kept_bytes += len(data)
        except (sqlite3.Error, LookupError, TypeError, *DECOMPRESSION_ERRORS) as error:
            cause = f"is damaged ({shortened(str(error), 100)})"
            index.damage = Damage(cause, kept_bytes, size)
        finally:
            self._open().set_progress_handler(None, 0)
        return index

    def payload(self, block: int, offset: int, size: int) -> memoryview:
        """Fetch the message in row `offset`."""
        query = "SELECT data FROM messages WHERE rowid = ?"
        row = self._open().execute(query, (offset,)).fetchone()
        # A damaged index may no longer find what a walk through the table found.
        return self._unpack(row[0] if row and isinstance(row[0], bytes) else b"")

    def part(self, blocks: Iterable[int]) -> SqliteFile:
        """The same file: a row is found by its number alone."""
        return SqliteFile(self._file_path, self.path, self._compression)

    def close(self) -> None:
        """Close the database."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _open(self) -> sqlite3.Connection:
        if self._connection is None:
            # Without a write-ahead log there is nothing to lock, and a folder may be read-only.
            log = self._file_path.with_name(self._file_path.name + "-wal")
            mode = "mode=ro" if log.exists() else "mode=ro&immutable=1"
            location = f"{self._file_path.resolve().as_uri()}?{mode}"
            self._connection = sqlite3.connect(location, uri=True)
            # sqlite3 refuses a file shorter than its header says, unless it is told that somebody
            # means to repair it.  Nothing is written: the file is opened for reading only.
            self._connection.execute("PRAGMA writable_schema = ON")
            if sys.version_info >= (3, 11):
                self._connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_CHUNK_BYTES)
        return self._connection

    def _read_topics(self, index: MessageIndex) -> dict[int, int]:
        """Fill `index.topics`; positions in it by the database's topic number."""
        database = self._open()
        # Views are left out, and so are tables of modules and columns that are generated: what they
        # hold is computed, at whatever length their author chose.
        tables = {
            name
            for name, text in database.execute(
                "SELECT name, sql FROM sqlite_master WHERE type = 'table'"
            )
            if not str(text).lstrip().upper().startswith("CREATE VIRTUAL")
        }
        if not {"topics", "messages"} <= tables:
            raise BagError(self.path, "is not a rosbag2 recording: it has no topics and messages")
        for table in ("topics", "messages", "message_definitions"):
            declared = database.execute(f"PRAGMA table_xinfo({table})")
            if any(hidden for *_, hidden in declared):
                raise BagError(self.path, f"is no recording: {table} has columns that are computed")
        definitions = {}
        if "message_definitions" in tables:
            definitions = {
                message_type: (text, definition_format)
                for message_type, text, definition_format in database.execute(
                    "SELECT topic_type, encoded_message_definition, encoding"
                    " FROM message_definitions"
                )
            }
        columns = {name for _, name, *_ in database.execute("PRAGMA table_info(topics)")}
        # The first versions of rosbag2 did not record QoS.
        qos_column = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
        numbers = {}
        for topic_id, topic, message_type, encoding, qos in database.execute(
            f"SELECT id, name, type, serialization_format, {qos_column} FROM topics ORDER BY id"
        ):
            if not all(isinstance(text, str) for text in (topic, message_type, encoding)):
                raise TypeError(f"topic {topic_id} has no name, type or serialization")
            text, definition_format = definitions.get(message_type, ("", "ros2msg"))
            numbers[topic_id] = len(index.topics)
            index.topics.append(
                RecordedTopic(
                    topic,
                    message_type,
                    str(text or ""),
                    definition_format,
                    encoding,
                    offered_qos=str(qos or ""),
                )
            )
        return numbers

    def _unpack(self, data: bytes, allowance: Allowance | None = None) -> memoryview:
        if not self._compression:
            return memoryview(data)
        return memoryview(decompress(data, self._compression, allowance))
