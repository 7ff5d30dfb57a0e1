"""A recording's traces as files of cones, which are made once and found again."""

import hashlib
import json
import logging
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from usmap_ros.calibration.learnt import LearntReception
from usmap_ros.errors import BagError, file_errors
from usmap_ros.io.atomic import write_atomically
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.skipped import SkippedMessages
from usmap_ros.io.storage import is_recording
from usmap_ros.io.stretch import TraceStretch
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.reconstruction.shared_noise import SharedNoise
from usmap_ros.runs.collection.code_state import PACKAGE, reconstruction_state
from usmap_ros.runs.collection.tiles import Box, around
from usmap_ros.runs.offline import nothing_usable
from usmap_ros.runs.parallel import Reconstructors, stretch_cones
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.recorded import learn_reception, recorded_cones

#: Pings that are reconstructed at once: some seconds of work.
STRETCH = 2000


@dataclass(frozen=True)
class Cones:
    """The cones of a recording, or of a stretch of it."""

    #: Recordings that hold them.
    paths: list[str]
    #: What its pings reach.
    box_m: Box
    #: Number of pings left out, by the field of the message that was to blame.
    skipped: dict[str, int]
    #: What there was to be said of the recording.
    warnings: list[str]


@dataclass(frozen=True)
class Divided:
    """A long recording: what is known of it, and the stretches that anybody may reconstruct."""

    #: Where its cones would be, had it been reconstructed as a whole.
    name: Path
    #: What did not have to be reconstructed.
    begun: Cones
    #: Where cones are to be written, of which traces, and levels of noise of those that state none.
    stretches: list[tuple[Path, TraceStretch, list[float]]]
    #: How they are reconstructed.
    reception: LearntReception


def find_recordings(places: Sequence[Path], besides: Path) -> list[Path]:
    """Recordings at some places, those in the folders below them included.

    Parameters
    ----------
    places : sequence of path
        Recordings, which stay as they are, or folders with recordings somewhere in them.
    besides : path
        Folder in which none is looked for: it gets the map.
    """
    found: dict[Path, None] = {}
    for place in places:
        inside = [place] if is_recording(place) else list(_below(place, besides.resolve()))
        # A place with nothing in it stays, so that whoever opens it can say what is wrong.
        found |= dict.fromkeys(inside or [place])
    return list(found)


def _below(folder: Path, besides: Path) -> Iterator[Path]:
    if not folder.is_dir():
        return
    for entry in sorted(folder.iterdir()):
        if not entry.is_dir() or entry.name.startswith(".") or entry.resolve() == besides:
            continue
        if is_recording(entry):
            yield entry
        else:
            yield from _below(entry, besides)


def cones_of_recording(
    recording: Path, folder: Path, parameters: PipelineParameters, length: int
) -> Cones | Divided:
    """Reconstruct a recording into a file in `folder`, unless that was done before.

    Parameters
    ----------
    recording : path
        A bag's folder, or a bare file.
    folder : path
        Where cones are kept.
    parameters : PipelineParameters
        Of which those of reconstruction count.
    length : int
        Traces from which on it is only divided.

    Raises
    ------
    BagError
        If the recording cannot be used, or its cones cannot be written.
    """
    name = folder / f"{recording.name}-{_digest(recording, parameters)}"
    if (kept := _kept(name)) is not None:
        return kept
    with _warnings() as warnings, BagReader([recording]) as bag:
        # What had to be unpacked lies in a folder of this process.
        is_long = bag.trace_count > length and not bag.is_unpacked
        pipeline = Pipeline(parameters)
        workers = Reconstructors(pipeline)
        learn_reception(bag, pipeline, workers)
        stretches = list(_stretches(bag, pipeline.noise, name, length)) if is_long else []
        cones = bag.range_cones() if is_long else recorded_cones(bag, workers)
        made = _write(name, cones, bag.skipped)
    if is_long:
        return Divided(name, replace(made, warnings=warnings), stretches, pipeline.reception)
    if not made.paths:
        raise nothing_usable([recording], bag.skipped.by_field)
    return keep(name, replace(made, warnings=warnings))


def _stretches(
    bag: BagReader, noise: SharedNoise, name: Path, length: int
) -> Iterator[tuple[Path, TraceStretch, list[float]]]:
    for number, stretch in enumerate(bag.trace_stretch.cuts(length)):
        levels = noise.levels(stretch.traces_without_noise())
        # Files that are open cannot be sent.
        stretch.messages.close()
        yield name.parent / f"{name.name}-{length}-{number}", stretch, levels


def cones_of_stretch(
    name: Path, stretch: TraceStretch, levels: list[float], reception: LearntReception
) -> Cones:
    """Reconstruct a stretch of a recording into a file, unless that was done before.

    Raises
    ------
    BagError
        If its cones cannot be written.
    """
    if (kept := _kept(name)) is not None:
        return kept
    with _warnings() as warnings:
        found = stretch_cones(stretch, levels, reception)
        skipped = SkippedMessages()
        for source, error in found.skipped:
            skipped.add(source, error)
        made = _write(name, found.cones, skipped)
    return keep(name, replace(made, warnings=warnings))


def joined(name: Path, parts: Sequence[Cones]) -> Cones:
    """The cones of a recording from those of its stretches.

    Raises
    ------
    BagError
        If there are none, or what is known of them cannot be written.
    """
    skipped = Counter[str]()
    for part in parts:
        skipped.update(part.skipped)
    paths = [path for part in parts for path in part.paths]
    if not paths:
        raise nothing_usable([name], skipped)
    warnings = [text for part in parts for text in part.warnings]
    return keep(name, Cones(paths, around([part.box_m for part in parts]), dict(skipped), warnings))


def keep(name: Path, cones: Cones) -> Cones:
    """Note what cones there are, once they are complete."""
    told = _note(name)
    with file_errors(BagError, told):
        told.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(told, json.dumps(asdict(cones)).encode())
    return cones


def _kept(name: Path) -> Cones | None:
    """Cones that were made before."""
    try:
        return Cones(**json.loads(_note(name).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None


def _note(name: Path) -> Path:
    return name.parent / f"{name.name}.json"


def _write(name: Path, cones: Iterable[tuple[str, EchoCone]], skipped: SkippedMessages) -> Cones:
    """Write cones into a recording, if there are any."""
    lowest_m, highest_m = np.full(2, np.inf), np.full(2, -np.inf)
    coming = iter(cones)
    first = next(coming, None)
    if first is not None:
        with new_bag(name, replace=True) as writer:
            for topic, cone in chain([first], coming):
                writer.write_cone(topic, cone)
                position_m, reach_m = cone.pose.position_m[:2], cone.transducer.max_range_m
                lowest_m = np.minimum(lowest_m, position_m - reach_m)
                highest_m = np.maximum(highest_m, position_m + reach_m)
    west, south, east, north = map(float, (*lowest_m, *highest_m))
    paths = [] if first is None else [str(name)]
    return Cones(paths, (west, south, east, north), dict(skipped.by_field), [])


def _digest(recording: Path, parameters: PipelineParameters) -> str:
    """Of all that cones depend on, the code that makes them included.

    Of the recording's files their sizes and dates count.
    """
    digest = hashlib.sha256(f"{reconstruction_state(PACKAGE)} {recording.resolve()}".encode())
    digest.update(parameters.reconstruction.model_dump_json().encode())
    walls = parameters.reconstruction.known_walls
    files = sorted(recording.iterdir()) if recording.is_dir() else [recording]
    for file in [*files, *([Path(walls)] if walls else [])]:
        if file.exists():
            status = file.stat()
            digest.update(f"{file.name} {status.st_size} {status.st_mtime_ns}".encode())
    return digest.hexdigest()[:16]


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """Gather the package's warnings, which a worker elsewhere would tell nobody."""
    gathered: list[str] = []

    class Gatherer(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            gathered.append(record.getMessage())

    logger = logging.getLogger("usmap_ros")
    before = logger.handlers, logger.propagate
    logger.handlers, logger.propagate = [Gatherer(logging.WARNING)], False
    try:
        yield gathered
    finally:
        logger.handlers, logger.propagate = before
