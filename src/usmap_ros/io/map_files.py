"""The folder that ``usmap map`` writes, and the truth that a map is scored against.

In the folder are the map for nav2, the map as log-odds, and a summary.
"""

import io
import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.bounds import MAX_NAME
from usmap_ros.errors import MapFileError, file_errors
from usmap_ros.grids import (
    FREE_VALUE,
    LAYERS,
    OCCUPIED_PROBABILITY,
    OCCUPIED_VALUE,
    GridGeometry,
    OccupancyMap,
    TruthMap,
)
from usmap_ros.io.array_archive import load_arrays, numbers
from usmap_ros.io.atomic import write_atomically
from usmap_ros.io.file_set import replace_files
from usmap_ros.io.nav2_map import load_nav2_map, nav2_files, save_nav2_map
from usmap_ros.pings.fields_of_view import Beam
from usmap_ros.pings.robot_paths import RobotPaths

GRID_FILE = "map.npz"
NAV2_FILE = "map.yaml"
SUMMARY_FILE = "summary.json"
#: Folder of where each transducer was, as TUM files, where poses were refined.
PATHS_FOLDER, TOLD_FOLDER = "paths", "told"

#: Names of the arrays in it that are read.
_ARRAYS = (
    "log_odds",
    "observed",
    "resolution",
    "origin",
    "frame_id",
    "stamp_ns",
    "path_topics",
    "path_lengths",
    "path_positions",
    "path_beams",
    "path_stamps_ns",
    *LAYERS,
)
#: Sides of cells that are believed, m, and how far from the frame's origin a map may lie.
_RESOLUTIONS_M, _FARTHEST_M = (1e-4, 1e3), 2e7
#: Layers hold angles in rad, cosines and shares.
_GREATEST_LAYER = 10.0


@contextmanager
def map_folder(folder: Path) -> Iterator[None]:
    """Make sure that a map can be saved in `folder`, before much work goes into the map.

    A folder that had to be made is removed again if the block raises.

    Raises
    ------
    MapFileError
        If the folder cannot be made or written to.
    """
    existed = folder.exists()
    folder = Path(folder)
    with file_errors(MapFileError, folder):
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".usmap"
        write_atomically(probe, b"")
        probe.unlink()
    try:
        yield
    except BaseException:
        if not existed:
            shutil.rmtree(folder, ignore_errors=True)
        raise


def save_map(
    folder: str | Path,
    occupancy: OccupancyMap,
    paths: RobotPaths | None = None,
    summarize: Callable[[], dict[str, Any]] = dict,
) -> dict[str, Any]:
    """Write ``map.npz``, ``map.pgm``, ``map.yaml`` and ``summary.json``, all in one step.

    Whoever is killed at it leaves all as they were before, or all as they are to be.

    Parameters
    ----------
    folder : path
        Made if it is not there; other files in it are left alone.
    occupancy : OccupancyMap
        What is written: as an image for nav2, and as arrays.
    paths : RobotPaths, optional
        Kept in ``map.npz`` beside the map.
    summarize : callable
        Gives the summary, once all else is done; without any there is no ``summary.json``.

    Returns
    -------
    summary : dict
        What `summarize` gave.

    Raises
    ------
    MapFileError
        If a file cannot be written: then all are as they were.
    """
    folder = Path(folder)
    files = {GRID_FILE: _to_bytes(occupancy, paths or RobotPaths())}
    files |= nav2_files(folder / NAV2_FILE, occupancy.geometry, occupancy.trinary())
    if summary := summarize():
        files[SUMMARY_FILE] = (json.dumps(summary, indent=2) + "\n").encode()
    with file_errors(MapFileError, folder):
        folder.mkdir(parents=True, exist_ok=True)
        replace_files(folder, files, gone=[SUMMARY_FILE])
    return summary


def load_map(folder: str | Path) -> tuple[OccupancyMap, RobotPaths]:
    """Load what `save_map` saved.

    Parameters
    ----------
    folder : path
        The folder, or the ``map.npz`` itself.

    Raises
    ------
    MapFileError
        If there is no map, or its arrays do not fit together.
    """
    path = Path(folder)
    if path.is_dir():
        path /= GRID_FILE
    if not path.exists():
        raise MapFileError(path, "does not exist; 'usmap map' writes it")
    try:
        with file_errors(MapFileError, path, "read"):
            arrays = load_arrays(path, _ARRAYS)
    except ValueError as error:
        raise MapFileError(path, f"is not a readable map.npz: {error}") from error
    try:
        return _map_from(arrays), _paths_from(arrays)
    except KeyError as error:
        raise MapFileError(path, f"lacks the array {error.args[0]!r}") from error
    except (TypeError, ValueError) as error:
        raise MapFileError(path, f"holds arrays that make no map: {error}") from error


def save_truth(path: Path, truth: TruthMap) -> None:
    """Write a truth map in nav2's format: every cell is occupied or free.

    Raises
    ------
    MapFileError
        If a file cannot be written.
    """
    values = np.where(truth.occupied, OCCUPIED_VALUE, FREE_VALUE).astype(np.int8)
    save_nav2_map(path, truth.geometry, values)


def load_truth(path: str | Path) -> TruthMap:
    """Load the occupied cells of any nav2 map, as what a map is scored against.

    Parameters
    ----------
    path : path
        Its YAML file.

    Raises
    ------
    MapFileError
        If it cannot be read.
    """
    nav2_map = load_nav2_map(Path(path))
    # Unknown cells are NaN, which compares as not occupied.
    return TruthMap(nav2_map.geometry, nav2_map.probability >= OCCUPIED_PROBABILITY)


def _to_bytes(occupancy: OccupancyMap, paths: RobotPaths) -> bytes:
    positions, beams = list(paths.positions_m.values()), list(paths.beams.values())
    stamps_ns = list(paths.stamps_ns.values())
    # Any: savez_compressed has an argument of its own that is no array.
    layers: dict[str, Any] = dict(occupancy.layers)
    content = io.BytesIO()
    np.savez_compressed(
        content,
        log_odds=occupancy.log_odds.astype(np.float32),
        observed=occupancy.observed.astype(np.bool_),
        resolution=np.float64(occupancy.geometry.resolution_m),
        origin=np.array(occupancy.geometry.origin_m, dtype=np.float64),
        frame_id=np.array(occupancy.frame_id),
        stamp_ns=np.int64(occupancy.stamp_ns),
        path_topics=np.array(list(paths.positions_m), dtype=np.str_),
        path_lengths=np.array([len(path) for path in positions], dtype=np.int64),
        path_positions=np.concatenate([np.zeros((0, 2)), *positions]).astype(np.float32),
        path_beams=np.concatenate([np.zeros((0, 3)), *beams]).astype(np.float32),
        path_stamps_ns=np.concatenate([np.zeros(0, np.int64), *stamps_ns]),
        **layers,
    )
    return content.getvalue()


def _map_from(arrays: dict[str, NDArray[Any]]) -> OccupancyMap:
    log_odds = numbers(arrays, "log_odds", 2, np.float32)
    observed = numbers(arrays, "observed", 2, np.bool_)
    if log_odds.shape != observed.shape:
        raise ValueError(f"log_odds is {log_odds.shape} and observed {observed.shape}")
    if not np.all(np.isfinite(log_odds)):
        raise ValueError("log_odds is not finite everywhere")
    resolution = float(numbers(arrays, "resolution", 0, np.float64))
    x, y = (float(value) for value in numbers(arrays, "origin", 1, np.float64))
    least_m, greatest_m = _RESOLUTIONS_M
    if not (least_m <= resolution <= greatest_m and max(abs(x), abs(y)) <= _FARTHEST_M):
        raise ValueError(f"resolution is {resolution:g} and origin {x:g}, {y:g}")
    layers = {name: numbers(arrays, name, 2, np.float32) for name in LAYERS if name in arrays}
    for name, layer in layers.items():
        if layer.shape != log_odds.shape:
            raise ValueError(f"log_odds is {log_odds.shape} and {name} {layer.shape}")
        # Where a layer says nothing it has NaN.
        greatest = max(
            -float(np.fmin.reduce(layer, axis=None, initial=0.0)),
            float(np.fmax.reduce(layer, axis=None, initial=0.0)),
        )
        if greatest > _GREATEST_LAYER:
            raise ValueError(f"{name} is up to {greatest:g}")
    rows, columns = log_odds.shape
    return OccupancyMap(
        geometry=GridGeometry(resolution, (x, y), (rows, columns)),
        log_odds=log_odds,
        observed=observed,
        frame_id=_text(arrays["frame_id"]),
        # Optional: the contract does not name it.
        stamp_ns=int(
            numbers({"stamp_ns": np.zeros((), np.int64), **arrays}, "stamp_ns", 0, np.int64)
        ),
        layers=layers,
    )


def _text(array: NDArray[Any]) -> str:
    """A frame's name; texts that are no name of one are refused."""
    if array.ndim or array.dtype.kind != "U" or len(str(array)) > MAX_NAME:
        raise ValueError(f"frame_id is {array.dtype} {array.shape}")
    return str(array)


def _paths_from(arrays: dict[str, NDArray[Any]]) -> RobotPaths:
    """Robots' paths; none in a map that another program wrote."""
    if "path_topics" not in arrays:
        return RobotPaths()
    if arrays["path_topics"].ndim != 1:
        raise ValueError(f"path_topics is {arrays['path_topics'].shape}")
    paths = RobotPaths({str(topic): [] for topic in arrays["path_topics"]})
    positions = numbers(arrays, "path_positions", 2, np.float64)
    unknown = np.full((len(positions), len(Beam._fields)), np.nan)
    beams = numbers({"path_beams": unknown, **arrays}, "path_beams", 2, np.float64)
    if positions.shape[1:] != (2,) or beams.shape != unknown.shape:
        raise ValueError(f"path_positions is {positions.shape} and path_beams {beams.shape}")
    timeless = np.zeros(len(positions), np.int64)
    stamps_ns = numbers({"path_stamps_ns": timeless, **arrays}, "path_stamps_ns", 1, np.int64)
    if len(stamps_ns) != len(positions):
        raise ValueError(f"path_stamps_ns are {len(stamps_ns)} of {len(positions)} pings")
    if not np.all(np.isfinite(positions)):
        raise ValueError("path_positions is not finite everywhere")
    lengths = numbers(arrays, "path_lengths", 1, np.int64)
    if np.any(lengths < 0) or sum(map(int, lengths)) != len(positions):
        raise ValueError(f"path_lengths make {sum(map(int, lengths))} of {len(positions)} pings")
    if len(lengths) != len(arrays["path_topics"]):
        raise ValueError(
            f"path_lengths are of {len(lengths)} of {len(arrays['path_topics'])} paths"
        )
    beams[~np.isfinite(beams).all(axis=1)] = np.nan
    first = 0
    for topic, length in zip(arrays["path_topics"], map(int, lengths), strict=True):
        own = slice(first, first + length)
        paths.add_all(str(topic), positions[own], beams[own], stamps_ns[own])
        first += length
    return paths
