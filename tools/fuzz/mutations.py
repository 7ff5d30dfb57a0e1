"""Ways to make an input wrong: bytes, text, numbers, archives and databases."""

from __future__ import annotations

import io
import sqlite3
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import zstandard

Generator = np.random.Generator

NUMBERS = (
    0.0, -0.0, 1.0, -1.0, 1e-300, 1e-30, 1e-12, 1e-6, 1e-3, 1e3, 1e4, 1e6, 1e9, 1e15, 1e30, 1e100,
    1e300, -1e-12, -1e3, -1e30, float("nan"), float("inf"), float("-inf"),
)  # fmt: skip
INTEGERS = (
    0,
    1,
    -1,
    2,
    7,
    255,
    65_536,
    2**31 - 1,
    -(2**31),
    2**32,
    2**63 - 1,
    2**63,
    2**64,
    10**30,
)

#: Values that have broken readers of YAML.
_YAML_VALUES = (
    "!!int foo", "!!float x", "!!timestamp x", "2001-99-99", "2001-12-14t21:59:43.10-99:00",
    "!!python/object/apply:os.system [id]", "!!binary '###'", "!!set {a, b}", "!!omap [a: 1]",
    "!!bool maybe", "0x", "0b2", "1_000", "1:99:99", ".inf", "-.inf", ".nan", "~", "[]", "{}",
    "[[], {}]", "*missing", "&a [*a]", "{<<: 3}", "{<<: [1]}", "? [a]\n: b", "1e999", "9" * 400,
    "9" * 5000, "'unclosed", "\t", "%YAML 9.9", "--- a\n--- b", "\x00", "\ufeff", "[" * 1500,
    "{a: " * 1500, "- " * 1500, "!<tag:yaml.org,2002:int> zz", "!!null x", "!!seq {}", "!!map []",
    "!!str {a: 1}", "!!pairs [a]", "=", "<<", "1e30", "-1e30", "1e-300",
)  # fmt: skip


def mutate_bytes(content: bytes, generator: Generator) -> bytes:
    """Flip, cut, repeat, insert and overwrite, one to five times."""
    data = bytearray(content)
    for _ in range(int(generator.integers(1, 6))):
        if not data:
            return bytes(data)
        start = int(generator.integers(len(data)))
        length = int(generator.integers(1, 1 + min(64, len(data) - start)))
        match int(generator.integers(7)):
            case 0:
                data[start] ^= 1 << int(generator.integers(8))
            case 1:
                del data[start:]
            case 2:
                del data[start : start + length]
            case 3:
                data[start:start] = data[start : start + length]
            case 4:
                data[start : start + length] = generator.bytes(length)
            case 5:
                data[start : start + length] = b"\xff" * length
            case 6:
                data[start : start + 8] = int(generator.choice([0, 1, 255, 2**31, 2**62])).to_bytes(
                    8, "little"
                )
    return bytes(data)


def mutate_yaml(text: str, generator: Generator) -> str:
    """Replace values, repeat and drop lines, add bombs, or damage the text."""
    kind = int(generator.integers(8))
    if kind == 0:
        return mutate_bytes(text.encode(), generator).decode("utf-8", errors="surrogateescape")
    if kind == 1:
        return text + _bomb(generator)
    lines = text.splitlines()
    for _ in range(int(generator.integers(1, 4))):
        place = int(generator.integers(len(lines)))
        line = lines[place]
        if kind == 2:
            lines.insert(place, lines[int(generator.integers(len(lines)))])
        elif kind == 3 and len(lines) > 1:
            del lines[place]
        elif ":" in line:
            key = line.partition(":")[0]
            lines[place] = f"{key}: {_yaml_value(generator)}"
    return "\n".join(lines) + "\n"


def _yaml_value(generator: Generator) -> str:
    kind = int(generator.integers(3))
    if kind == 0:
        return repr(NUMBERS[int(generator.integers(len(NUMBERS)))]).replace("nan", ".nan")
    if kind == 1:
        return str(INTEGERS[int(generator.integers(len(INTEGERS)))])
    return _YAML_VALUES[int(generator.integers(len(_YAML_VALUES)))]


def _bomb(generator: Generator) -> str:
    """A few lines that stand for very many."""
    depth = int(generator.integers(4, 30))
    if generator.integers(2):
        levels = [f"b{n}: &b{n} [{', '.join([f'*b{n - 1}'] * 9)}]" for n in range(1, depth)]
        return "\n".join(["", "b0: &b0 [x]", *levels, ""])
    levels = [f"m{n}: &m{n} {{<<: [{', '.join([f'*m{n - 1}'] * 9)}]}}" for n in range(1, depth)]
    return "\n".join(["", "m0: &m0 {x: 1}", *levels, ""])


def odd_array(generator: Generator, array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Something else in place of an array: of another shape, type or content."""
    odd = NUMBERS[int(generator.integers(len(NUMBERS)))]
    changed = np.array(array, copy=True)
    if changed.dtype.kind == "f" and changed.size:
        with np.errstate(over="ignore"):
            changed.reshape(-1)[int(generator.integers(changed.size))] = odd
    choices = [
        np.array(odd),
        np.array(["text", "more"]),
        np.zeros((0,) * max(array.ndim, 1)),
        np.zeros((2, 3, 4)),
        np.array(2**63, dtype=np.uint64),
        array.astype(str) if array.size < 100 else array.T,
        array.astype(complex) if array.dtype.kind in "fib" else array[..., None],
        changed,
    ]
    return choices[int(generator.integers(len(choices)))]


def mutate_archive(content: bytes, generator: Generator) -> bytes:
    """Replace members of an .npz by other arrays, by lies about their size, or by no arrays."""
    if generator.integers(4) == 0:
        return mutate_bytes(content, generator)
    with np.load(io.BytesIO(content)) as archive:
        arrays = dict(archive)
    changed = io.BytesIO()
    victims = set(generator.choice(list(arrays), size=int(generator.integers(1, 4))))
    with zipfile.ZipFile(changed, "w") as target:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.save(member, odd_array(generator, array) if name in victims else array)
            data, file_name = member.getvalue(), f"{name}.npy"
            if name in victims:
                match int(generator.integers(6)):
                    case 0:
                        data = _claiming(data, "(1000000, 1000000)")
                    case 1:
                        data, file_name = b"no array", name
                    case 2:
                        data = _claiming(data, "(-1,)")
                    case 3:
                        data = data[: len(data) // 2]
                    case _:
                        pass
            target.writestr(file_name, data)
    return changed.getvalue()


def _claiming(data: bytes, shape: str) -> bytes:
    """An array whose header promises another shape, of a header of the same length."""
    start = data.index(b"'shape':")
    stop = data.index(b"\n", start)
    text = f"'shape': {shape}, }}".encode()
    return data[:start] + text.ljust(stop - start) + data[stop:]


_STATEMENTS = (
    "UPDATE {table} SET {column} = NULL",
    "UPDATE {table} SET {column} = 9223372036854775807",
    "UPDATE {table} SET {column} = -1",
    "UPDATE {table} SET {column} = 'text'",
    "UPDATE {table} SET {column} = x'00ff00'",
    "UPDATE {table} SET {column} = 1e300",
    "UPDATE {table} SET {column} = {column} + 7",
    "DELETE FROM {table}",
    "ALTER TABLE {table} RENAME TO other; CREATE VIEW {table} AS SELECT * FROM other",
    "ALTER TABLE {table} RENAME TO other; CREATE VIEW {table} AS SELECT *, 1 AS more FROM other",
    "ALTER TABLE {table} RENAME COLUMN {column} TO renamed",
    "INSERT INTO {table} SELECT * FROM {table}",
    "ALTER TABLE {table} DROP COLUMN {column};"
    " ALTER TABLE {table} ADD COLUMN {column} BLOB AS (zeroblob(900000000))",
    "DROP TABLE {table}; CREATE VIRTUAL TABLE {table} USING fts5({column})",
)


def mutate_database(content: bytes, generator: Generator, scratch: Path) -> bytes:
    """Change a database by SQL, or its bytes."""
    if generator.integers(3) == 0:
        return mutate_bytes(content, generator)
    path = scratch / "changed.db3"
    path.write_bytes(content)
    database = sqlite3.connect(path)
    columns = {
        "topics": ("id", "name", "type", "serialization_format", "offered_qos_profiles"),
        "messages": ("id", "topic_id", "timestamp", "data"),
    }
    for _ in range(int(generator.integers(1, 3))):
        table = str(generator.choice(list(columns)))
        column = str(generator.choice(columns[table]))
        statement = _STATEMENTS[int(generator.integers(len(_STATEMENTS)))]
        try:
            database.executescript(statement.format(table=table, column=column))
        except sqlite3.Error:
            continue
    database.close()
    return path.read_bytes()


def bomb_record(size: int) -> bytes:
    """A record of an MCAP file that nobody knows, of nothing."""
    return struct.pack("<BQ", 0x80, size) + bytes(size)


def bomb_chunk(size: int) -> bytes:
    """A chunk of an MCAP file that unpacks to so much of nothing, or of records of nothing."""
    content = bytes(size) if size % 3 else struct.pack("<BQ", 0x80, 0) * (size // 9)
    packed = zstandard.compress(content)
    head = struct.pack("<QQQII", 0, 0, len(content), 0, 4) + b"zstd"
    body = head + struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 6, len(body)) + body
