"""Few bytes that stand for very many are unpacked no further than is believed."""

import io
import sqlite3
import struct
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from PIL import Image

from usmap_ros import bounds
from usmap_ros.errors import BagError, FileError, MapFileError
from usmap_ros.grids import GridGeometry, OccupancyMap
from usmap_ros.importing.files import read_samples
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.map_files import load_map, save_map
from usmap_ros.io.nav2_map import load_nav2_map
from usmap_ros.io.storage import compression, mcap_scan, sqlite_file
from usmap_ros.io.storage.mcap_file import McapFile
from usmap_ros.pings.trace import EchoTrace

MIB = 2**20
MakeTrace = Callable[..., EchoTrace]
WriteBag = Callable[..., Path]


@pytest.fixture(autouse=True)
def _little_is_much(monkeypatch: pytest.MonkeyPatch) -> None:
    """Believe less than by default, so that tests need not unpack gigabytes."""
    monkeypatch.setattr(compression, "LEAST_UNPACKED_BYTES", 16 * MIB)
    monkeypatch.setattr(mcap_scan, "LEAST_RECORDS", 1000)


def chunk(content: bytes) -> bytes:
    """A chunk of an MCAP file."""
    packed = zstandard.compress(content)
    head = struct.pack("<QQQII", 0, 0, len(content), zlib.crc32(content), 4) + b"zstd"
    body = head + struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", 6, len(body)) + body


def scan(path: Path, *chunks: bytes) -> tuple[str, int]:
    """What is wrong with a file of chunks, and how many bytes of it are read."""
    path.write_bytes(mcap_scan.MAGIC + b"".join(chunks))
    damage = McapFile(path).scan(()).damage
    assert damage is not None
    return damage.cause, damage.kept_bytes


def test_chunks_of_an_mcap_file_share_what_it_may_unpack_to(tmp_path: Path) -> None:
    # A record that nobody knows, of 8 MiB of nothing.
    one = chunk(struct.pack("<BQ", 0x80, 8 * MIB) + bytes(8 * MIB))
    cause, kept_bytes = scan(tmp_path / "many.mcap", *[one] * 20)
    assert cause == "has a chunk that unpacks to more than is believed"
    assert kept_bytes < 3 * len(one)


def test_a_chunk_of_a_million_records_of_nothing_is_not_read_to_its_end(tmp_path: Path) -> None:
    nothing = chunk(struct.pack("<BQ", 0x80, 0) * 1_000_000)
    cause, _ = scan(tmp_path / "many.mcap", nothing)
    assert cause == "has a chunk of more records than are believed"


def test_a_file_that_is_packed_as_a_whole_fills_no_disk(
    make_trace: MakeTrace, write_bag: WriteBag, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (whole,) = write_bag("bag", [("/a", make_trace(0)), ("/a", make_trace(1))]).glob("*.mcap")
    packed = tmp_path / "big.mcap.zst"
    packed.write_bytes(zstandard.compress(whole.read_bytes()[:-8] + bytes(100 * MIB)))
    with BagReader([packed]) as bag:
        assert len(list(bag.traces())) == 2
        unpacked = [file.stat().st_size for file in Path(bag._scratch.name).iterdir()]
    assert sum(unpacked) <= 16 * MIB
    assert "unpacks to more than is believed" in caplog.text


@pytest.mark.parametrize("kind", ["generated", "virtual", "endless"])
def test_a_database_that_computes_its_messages_is_no_recording(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sqlite_file, "LEAST_SQLITE_STEPS", 20_000)
    monkeypatch.setattr(sqlite_file, "MAX_SQLITE_STEPS_PER_BYTE", 0)
    path = tmp_path / "bag.db3"
    database = sqlite3.connect(path)
    database.execute(
        "CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT)"
    )
    database.execute("INSERT INTO topics VALUES (1, '/a', 'usmap_msgs/msg/EchoTrace', 'cdr')")
    if kind == "generated":
        database.execute(
            "CREATE TABLE messages(topic_id INTEGER, timestamp INTEGER,"
            " data BLOB GENERATED ALWAYS AS (zeroblob(900000000)))"
        )
        database.executemany("INSERT INTO messages VALUES (1, ?)", [(n,) for n in range(100)])
    elif kind == "virtual":
        database.execute("CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data)")
    else:
        database.execute("CREATE TABLE messages(topic_id INTEGER, timestamp INTEGER, data BLOB)")
        database.executemany("INSERT INTO messages VALUES (1, ?, x'')", [(n,) for n in range(9999)])
    database.commit()
    database.close()
    if kind == "endless":
        with BagReader([path]) as bag:
            assert bag.trace_count < 9999
        return
    with pytest.raises(BagError, match=r"columns that are computed|no topics and messages"):
        BagReader([path])


def map_of(side: int) -> OccupancyMap:
    geometry = GridGeometry(0.05, (0.0, 0.0), (side, side))
    shape = geometry.shape
    return OccupancyMap(geometry, np.zeros(shape, np.float32), np.ones(shape, np.bool_), "map")


def test_a_map_takes_little_more_memory_than_its_arrays(tmp_path: Path) -> None:
    save_map(tmp_path, map_of(2000))
    tracemalloc.start()
    load_map(tmp_path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1.5 * 5 * 2000**2


def test_arrays_of_a_map_that_unpack_to_too_much_are_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_map(tmp_path, map_of(1000))
    monkeypatch.setattr("usmap_ros.io.array_archive.MAX_ARRAY_BYTES", MIB)
    with pytest.raises(MapFileError, match="take more than 1 MiB"):
        load_map(tmp_path)


def test_one_long_name_of_a_robot_is_not_repeated_for_each_of_its_pings(tmp_path: Path) -> None:
    save_map(tmp_path, map_of(2))
    pings = 200_000
    with np.load(tmp_path / "map.npz") as archive:
        arrays = dict(archive)
    arrays |= {
        "path_topics": np.array(["x" * 2000]),
        "path_lengths": np.array([pings]),
        "path_positions": np.zeros((pings, 2), np.float32),
        "path_beams": np.zeros((pings, 3), np.float32),
        "path_stamps_ns": np.zeros(pings, np.int64),
    }
    np.savez_compressed(tmp_path / "map.npz", **arrays)
    tracemalloc.start()
    _, paths = load_map(tmp_path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(paths.positions_m["x" * 2000]) == pings
    assert peak < 300 * pings


@pytest.mark.parametrize("mode", ["L", "RGBA"])
def test_an_image_takes_little_more_memory_than_the_map_in_it(tmp_path: Path, mode: str) -> None:
    side = 1500
    Image.new(mode, (side, side)).save(tmp_path / "map.png")
    (tmp_path / "map.yaml").write_text(
        "{image: map.png, resolution: 0.05, origin: [0, 0, 0], negate: 0}"
    )
    # What is imported at the first call is not meant.
    load_nav2_map(tmp_path / "map.yaml")
    tracemalloc.start()
    load_nav2_map(tmp_path / "map.yaml")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 16 * side**2


def test_a_header_that_promises_terabytes_is_no_samples(tmp_path: Path) -> None:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        header, {"descr": "<f8", "fortran_order": False, "shape": (10**7, 10**6)}
    )
    (tmp_path / "samples.npy").write_bytes(header.getvalue())
    with zipfile.ZipFile(tmp_path / "samples.npz", "w") as archive:
        archive.writestr("samples.npy", header.getvalue())
    for name in ("samples.npy", "samples.npz"):
        with pytest.raises(FileError, match="NumPy file"):
            read_samples(tmp_path, name, "samples")


def test_every_limit_is_said_in_the_docs(request: pytest.FixtureRequest) -> None:
    text = (request.config.rootpath / "docs/formats.md").read_text()
    for limit in (bounds.MAX_CHUNK_BYTES, bounds.MAX_ARRAY_BYTES):
        assert f"{limit // MIB} MiB" in text
    assert f"{bounds.MAX_UNPACKED_RATIO} times its size" in text
    assert f"{bounds.MAX_PIXELS // 10**6} million pixels" in text
