"""The kinds of input that are made wrong, and what is done with each."""

from __future__ import annotations

import io
import itertools
import shutil
import sqlite3
import struct
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mutations import (
    INTEGERS,
    NUMBERS,
    Generator,
    bomb_chunk,
    bomb_record,
    mutate_archive,
    mutate_bytes,
    mutate_database,
    mutate_yaml,
)
from PIL import Image
from rosbags.serde import SerdeError

from usmap_ros.errors import UsmapError
from usmap_ros.importing.files import COLUMNS, read_poses, read_samples
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.conversions import cone_from_cdr, cone_to_cdr, trace_from_cdr, trace_to_cdr
from usmap_ros.io.map_files import GRID_FILE, load_map, save_map
from usmap_ros.io.message_types import ECHO_CONE, ECHO_TRACE, typestore
from usmap_ros.io.nav2_map import load_nav2_map
from usmap_ros.io.raw_reader import RawBagReader, recorded_qos
from usmap_ros.io.yaml_files import load_yaml
from usmap_ros.live.live_fusion import LiveFusion
from usmap_ros.parameters import MappingParameters, PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

ROOT = Path(__file__).parents[2]

#: What rosbags says of numbers that no message can hold.
UNSENDABLE = (SerdeError, struct.error, OverflowError, ValueError, AssertionError)

#: Makes one input wrong and uses it; an error of the project's own is an answer.
Attempt = Callable[[Generator], None]


@dataclass(frozen=True)
class Kind:
    """One kind of input.

    Parameters
    ----------
    name : str
        Such as ``scenario``.
    attempt : callable
        Makes one wrong and uses it.
    """

    name: str
    attempt: Attempt


def all_kinds(scratch: Path) -> list[Kind]:
    """Every kind, with its files in the folder `scratch`."""
    pings = _pings()
    return [
        Kind("scenario", _scenario(scratch)),
        Kind("parameters", _parameters(scratch)),
        Kind("nav2 map", _nav2_map(scratch)),
        Kind("image", _image(scratch)),
        Kind("metadata", _metadata(scratch, pings)),
        Kind("mcap", _mcap(scratch, pings)),
        Kind("sqlite3", _sqlite(scratch, pings)),
        Kind("packed", _packed(scratch, pings)),
        Kind("samples", _samples(scratch)),
        Kind("map.npz", _archive(scratch, pings)),
        Kind("trace", _trace(pings)),
        Kind("cone", _cone(pings)),
        Kind("poses", _poses(pings)),
    ]


def _pings() -> list[tuple[str, EchoTrace]]:
    scenario = Scenario.load(ROOT / "config/scenarios/poles.yaml")
    return list(itertools.islice(simulate(scenario), 4))


# ---- text


def _write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8", errors="surrogateescape")
    return path


def _scenario(scratch: Path) -> Attempt:
    texts = [
        (ROOT / f"config/scenarios/{name}.yaml").read_text()
        for name in ("poles", "room", "two_transducers", "chirps")
    ]

    def attempt(generator: Generator) -> None:
        text = mutate_yaml(texts[int(generator.integers(len(texts)))], generator)
        scenario = Scenario.load(_write(scratch / "scenario.yaml", text))
        # What a scenario says it takes is the user's to choose; here a little must be enough.
        if len(scenario.robots) > 10 or scenario.duration_s > 100.0:
            return
        for _ in itertools.islice(simulate(scenario), 4):
            pass
        scenario.truth_map(0.2)

    return attempt


def _parameters(scratch: Path) -> Attempt:
    text = (ROOT / "config/parameters/defaults.yaml").read_text()

    def attempt(generator: Generator) -> None:
        path = _write(scratch / "parameters.yaml", mutate_yaml(text, generator))
        Pipeline(load_yaml(path, PipelineParameters))

    return attempt


def _nav2_map(scratch: Path) -> Attempt:
    shutil.copy(ROOT / "config/maps/flat.pgm", scratch)
    text = (ROOT / "config/maps/flat.yaml").read_text()

    def attempt(generator: Generator) -> None:
        load_nav2_map(_write(scratch / "nav2.yaml", mutate_yaml(text, generator)))

    return attempt


def _image(scratch: Path) -> Attempt:
    text = (ROOT / "config/maps/flat.yaml").read_text()
    with Image.open(ROOT / "config/maps/flat.pgm") as image:
        plain = image.convert("L").resize((40, 30))
    contents = []
    for form in ("PPM", "PNG", "TIFF", "BMP", "GIF"):
        stored = io.BytesIO()
        plain.save(stored, format=form)
        contents.append(stored.getvalue())
    contents.append(b"P5\n40 30\n255\n" + bytes(1200))
    contents.append(b"P5\n60000 60000\n255\n" + bytes(1200))
    description = _write(scratch / "image.yaml", text.replace("flat.pgm", "image.any"))

    def attempt(generator: Generator) -> None:
        content = contents[int(generator.integers(len(contents)))]
        (scratch / "image.any").write_bytes(mutate_bytes(content, generator))
        load_nav2_map(description)

    return attempt


# ---- recordings


def _read_bag(path: Path) -> None:
    with BagReader([path]) as bag:
        for _ in itertools.chain(bag.traces(), bag.cones()):
            pass
    raw = RawBagReader(path)
    try:
        for topic in raw.topics:
            recorded_qos(topic)
        for _ in raw.messages():
            pass
    finally:
        raw.close()


def _bag(scratch: Path, name: str, pings: list[tuple[str, EchoTrace]], compression: str) -> Path:
    with new_bag(scratch / name, replace=True, compression=compression) as writer:
        for topic, trace in pings:
            writer.write_trace(topic, trace)
    return scratch / name


def _metadata(scratch: Path, pings: list[tuple[str, EchoTrace]]) -> Attempt:
    folder = _bag(scratch, "described", pings[:1], "none")
    text = (folder / "metadata.yaml").read_text()

    def attempt(generator: Generator) -> None:
        _write(folder / "metadata.yaml", mutate_yaml(text, generator))
        _read_bag(folder)

    return attempt


def _mcap(scratch: Path, pings: list[tuple[str, EchoTrace]]) -> Attempt:
    contents = [
        next(_bag(scratch, name, pings, name).glob("*.mcap")).read_bytes()
        for name in ("none", "lz4", "zstd")
    ]

    def attempt(generator: Generator) -> None:
        content = contents[int(generator.integers(len(contents)))]
        path = scratch / "changed.mcap"
        path.write_bytes(mutate_bytes(content, generator))
        _read_bag(path)

    return attempt


def _sqlite(scratch: Path, pings: list[tuple[str, EchoTrace]]) -> Attempt:
    path = scratch / "whole.db3"
    path.unlink(missing_ok=True)
    database = sqlite3.connect(path)
    database.executescript(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
        " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
        " timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
    )
    # Without its constraints, which a file from elsewhere need not have either.
    text = [row[0] for row in database.execute("SELECT sql FROM sqlite_master")]
    database.executescript("DROP TABLE topics; DROP TABLE messages;")
    for statement in text:
        database.execute(statement.replace("NOT NULL", "").replace("PRIMARY KEY", ""))
    database.execute("INSERT INTO topics VALUES (1, '/robot1/echo', ?, 'cdr', '')", (ECHO_TRACE,))
    for number, (_, trace) in enumerate(pings):
        data = trace_to_cdr(trace)
        database.execute("INSERT INTO messages VALUES (?, 1, ?, ?)", (number, trace.stamp_ns, data))
    database.commit()
    database.close()
    content = path.read_bytes()

    def attempt(generator: Generator) -> None:
        changed = scratch / "read.db3"
        changed.write_bytes(mutate_database(content, generator, scratch))
        _read_bag(changed)

    return attempt


def _packed(scratch: Path, pings: list[tuple[str, EchoTrace]]) -> Attempt:
    """Files that are packed as a whole, and much that is packed in little."""
    content = next(_bag(scratch, "plain", pings, "none").glob("*.mcap")).read_bytes()
    path = scratch / "packed.mcap.zst"

    def attempt(generator: Generator) -> None:
        inner = content
        match int(generator.integers(4)):
            case 0:
                inner = mutate_bytes(content, generator)
            case 1:
                # Up to four gigabytes of nothing.
                inner = content[:-8] + bomb_record(2 ** int(generator.integers(20, 29)))
            case 2:
                inner = content[:-8] + bomb_chunk(2 ** int(generator.integers(20, 29))) * 8
        packed = zstandard.compress(inner)
        if generator.integers(3) == 0:
            packed = mutate_bytes(packed, generator)
        path.write_bytes(packed)
        _read_bag(path)

    return attempt


def _samples(scratch: Path) -> Attempt:
    """Arrays that somebody imports."""
    stored = io.BytesIO()
    columns = {name: np.arange(4.0) for name in COLUMNS}
    np.savez_compressed(stored, samples=np.zeros((4, 100), np.int16), **columns)
    content = stored.getvalue()

    def attempt(generator: Generator) -> None:
        (scratch / "samples.npz").write_bytes(mutate_archive(content, generator))
        read_samples(scratch, "samples.npz", "samples")
        read_poses(scratch, "", "samples.npz")

    return attempt


# ---- maps


def _archive(scratch: Path, pings: list[tuple[str, EchoTrace]]) -> Attempt:
    pipeline, paths = Pipeline(), RobotPaths()
    for topic, trace in pings:
        cone = pipeline.process(trace)
        paths.add(topic, *map(float, cone.pose.position_m[:2]))
    folder = scratch / "map"
    save_map(folder, pipeline.occupancy_map(), paths)
    content = (folder / GRID_FILE).read_bytes()

    def attempt(generator: Generator) -> None:
        (folder / GRID_FILE).write_bytes(mutate_archive(content, generator))
        occupancy, _ = load_map(folder)
        resumed = Pipeline()
        try:
            resumed.resume(occupancy)
        except ValueError as error:  # As its documentation says.
            raise UsmapError(str(error)) from error
        _check(resumed.occupancy_map())

    return attempt


# ---- messages


def _check(occupancy: Any) -> None:
    """Refuse a map with numbers in it that are none."""
    if not np.all(np.isfinite(occupancy.log_odds)):
        raise AssertionError("log-odds that are not finite")


def _changed(payload: bytes, message_type: str, generator: Generator) -> bytes:
    """Set some fields of a serialized message to something odd, or some of its bytes."""
    if generator.integers(4) == 0:
        return mutate_bytes(payload, generator)
    message = typestore().deserialize_cdr(payload, message_type)
    for _ in range(int(generator.integers(1, 4))):
        _change(message, generator)
    try:
        return bytes(typestore().serialize_cdr(message, message_type))
    except UNSENDABLE:
        return mutate_bytes(payload, generator)


def _change(message: Any, generator: Generator) -> None:
    """Set a field of a message, or of one in it, to something odd."""
    names = [name for name in message.__dataclass_fields__ if not name.startswith("_")]
    names = [name for name in names if not name.isupper()]
    name = str(generator.choice(names))
    value = getattr(message, name)
    if hasattr(value, "__dataclass_fields__"):
        _change(value, generator)
    elif isinstance(value, np.ndarray):
        setattr(message, name, _odd_values(value, generator))
    elif isinstance(value, str):
        setattr(message, name, str(generator.choice(["", "x" * 10_000, "a b", "\n\n", "ü"])))
    elif isinstance(value, float):
        factor = 10.0 ** float(generator.integers(-9, 10))
        odd = NUMBERS[int(generator.integers(len(NUMBERS)))]
        setattr(message, name, value * factor if generator.integers(2) else odd)
    elif isinstance(value, int):
        setattr(message, name, INTEGERS[int(generator.integers(len(INTEGERS)))])


def _odd_values(value: np.ndarray[Any, Any], generator: Generator) -> np.ndarray[Any, Any]:
    array = np.array(value, copy=True)
    kind = int(generator.integers(6))
    with np.errstate(all="ignore"):
        if kind == 0:
            return np.resize(array, int(generator.choice([0, 1, 2, 3, 255, 3000, 100_000])))
        if array.dtype.kind != "f":
            return generator.permutation(array)
        odd = NUMBERS[int(generator.integers(len(NUMBERS)))]
        if kind == 1 and len(array):
            array[int(generator.integers(len(array)))] = odd
        elif kind == 2:
            array[:] = odd
        elif kind == 3:
            array = (array * 10.0 ** float(generator.integers(-9, 10))).astype(array.dtype)
        elif kind == 4:
            return np.sort(np.resize(array, int(generator.choice([1, 2, 100, 3000]))))
        else:
            array = array[::-1].copy()
    return array


def _trace(pings: list[tuple[str, EchoTrace]]) -> Attempt:
    def attempt(generator: Generator) -> None:
        _, trace = pings[int(generator.integers(len(pings)))]
        payload = _changed(trace_to_cdr(trace), ECHO_TRACE, generator)
        pipeline = Pipeline()
        pipeline.process(trace_from_cdr(payload))
        _check(pipeline.occupancy_map())

    return attempt


def _cone(pings: list[tuple[str, EchoTrace]]) -> Attempt:
    pipeline = Pipeline()
    cones: list[EchoCone] = [pipeline.reconstruct(trace) for _, trace in pings]

    def attempt(generator: Generator) -> None:
        fusion = LiveFusion(MappingParameters(), order_wait_s=0.0, capacity=10)
        cone = cones[int(generator.integers(len(cones)))]
        payload = _changed(cone_to_cdr(cone), ECHO_CONE, generator)
        fusion.receive("/robot1/cone", cone_from_cdr(payload))
        fusion.fuse_next()
        # The next one must find a map that still works.
        fusion.receive("/robot2/cone", cones[0])
        while fusion.fuse_next() is not None:
            pass
        _check(fusion.occupancy_map())

    return attempt


#: Long enough for the map's frame and place to be decided on.
_ROUNDS = 20


def _poses(pings: list[tuple[str, EchoTrace]]) -> Attempt:
    """Three robots, one of which may say anything of frames, places and reach."""
    pipeline = Pipeline()
    cones: list[EchoCone] = [pipeline.reconstruct(trace) for _, trace in pings]

    def attempt(generator: Generator) -> None:
        fusion = LiveFusion(MappingParameters(), order_wait_s=0.0, capacity=1000)
        fused: Counter[str] = Counter()
        for number in range(_ROUNDS):
            for robot, cone in zip(("liar", "a", "b"), cones, strict=False):
                now = replace(cone, stamp_ns=cone.stamp_ns + number * 200_000_000)
                if robot == "liar" and generator.integers(3):
                    now = _astray(now, generator)
                with suppress(UsmapError):
                    fusion.receive(robot, now)
            while fusion.due_in_s() is not None:
                with suppress(UsmapError):
                    done = fusion.fuse_next()
                    fused[done.topic if done else ""] += 1
        # Whatever one says, the others are heard.
        if min(fused["a"], fused["b"]) < _ROUNDS:
            raise AssertionError(f"of honest robots, only {fused} are fused")
        _check(fusion.occupancy_map())

    return attempt


def _astray(cone: EchoCone, generator: Generator) -> EchoCone:
    """The same cone from somewhere else, in another frame, or of another reach."""
    away_m = generator.normal(size=3) * 10.0 ** float(generator.integers(-1, 7))
    match int(generator.integers(3)):
        case 0:
            return replace(cone, frame_id=str(generator.choice(["x", "odom", "MAP"])))
        case 1:
            position_m = cone.pose.position_m + away_m * (1.0, 1.0, 0.0)
            return replace(cone, pose=replace(cone.pose, position_m=position_m))
        case _:
            reach_m = float(np.clip(abs(away_m[0]), 0.5, 15.0))
            return replace(cone, transducer=replace(cone.transducer, max_range_m=reach_m))
