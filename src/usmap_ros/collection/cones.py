"""A recording's traces as a file of cones, which is made once and found again."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from usmap_ros import __version__
from usmap_ros.errors import BagError
from usmap_ros.io.atomic import write_atomically
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.storage import is_recording
from usmap_ros.offline import nothing_usable, recorded_cones
from usmap_ros.parallel import Reconstructors
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pipeline import Pipeline


@dataclass(frozen=True)
class ConesFile:
    """The cones of a recording.

    Parameters
    ----------
    path : str
        Recording that holds them.
    box_m : tuple of float
        Lowest x and y, and highest x and y, that its pings reach.
    skipped : dict
        Number of pings left out, by the field of the message that was to blame.
    warnings : list of str
        What there was to be said of the recording.
    """

    path: str
    box_m: tuple[float, float, float, float]
    skipped: dict[str, int]
    warnings: list[str]


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


def cones_file(recording: Path, folder: Path, parameters: PipelineParameters) -> ConesFile:
    """Reconstruct a recording into a file in `folder`, unless that was done before.

    Raises
    ------
    BagError
        If the recording cannot be used, or its cones cannot be written.
    """
    cones = folder / f"{recording.name}-{_digest(recording, parameters)}"
    told = cones.parent / f"{cones.name}.json"
    try:
        # It is written last: what it speaks of is complete.
        return ConesFile(**json.loads(told.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        made = _reconstruct(recording, cones, parameters)
    try:
        write_atomically(told, json.dumps(asdict(made)).encode())
    except OSError as error:
        raise BagError(told, f"cannot be written: {error.strerror}") from error
    return made


def _reconstruct(recording: Path, cones: Path, parameters: PipelineParameters) -> ConesFile:
    lowest_m, highest_m = np.full(2, np.inf), np.full(2, -np.inf)
    with _warnings() as warnings, BagReader([recording]) as bag:
        with new_bag(cones, replace=True) as writer:
            for topic, cone in recorded_cones(bag, Reconstructors(Pipeline(parameters))):
                writer.write_cone(topic, cone)
                position_m, reach_m = cone.pose.position_m[:2], cone.transducer.max_range_m
                lowest_m = np.minimum(lowest_m, position_m - reach_m)
                highest_m = np.maximum(highest_m, position_m + reach_m)
        if not np.isfinite(lowest_m).all():
            raise nothing_usable(bag)
        west, south, east, north = map(float, (*lowest_m, *highest_m))
        skipped = dict(bag.skipped.by_field)
    return ConesFile(str(cones), (west, south, east, north), skipped, warnings)


def _digest(recording: Path, parameters: PipelineParameters) -> str:
    """Of all that cones depend on; of the recording's files, their sizes and dates."""
    digest = hashlib.sha256(f"{__version__} {recording.resolve()}".encode())
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
