"""Arrays from files: samples with a row a ping, and poses by name."""

import csv
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import wavfile

from usmap_ros.errors import FileError, file_errors
from usmap_ros.io.array_archive import array_names, load_arrays
from usmap_ros.numerics.arrays import FloatArray

#: Names of poses' columns; those that need not be there have a value for all pings.
COLUMNS = ("time_s", "x_m", "y_m", "z_m", "yaw_rad")
OPTIONAL = {"z_m": 0.0}


@dataclass(frozen=True)
class ReadSamples:
    """Samples as files hold them."""

    #: A ping each, or all pings one after another in a single one.
    rows: Sequence[NDArray[Any]]
    #: As a file states it; 0: none does.
    rate_hz: float = 0.0
    #: Whether the one row holds all pings.
    is_continuous: bool = False


def read_samples(folder: Path, path: str, name: str) -> ReadSamples:
    """Samples of the files that a description names; see `SamplesModel`.

    Raises
    ------
    FileError
        If they cannot be read, or hold something else.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".wav":
        return _read_waves(folder, path)
    file = folder / path
    if suffix == ".npz":
        rows = _array_of(file, name)
    elif suffix == ".npy":
        rows = _loaded(file)
    elif suffix == ".csv":
        rows = _read_table(file)
    else:
        raise FileError(file, "must be a .npz, .npy, .csv or .wav file")
    if not isinstance(rows, np.ndarray) or rows.ndim != 2 or rows.dtype.kind not in "iufc":
        raise FileError(file, "must hold numbers in two dimensions, a row a ping")
    return ReadSamples(list(rows))


def read_poses(folder: Path, path: str, samples_path: str) -> dict[str, FloatArray]:
    """Columns of poses by name; see `PosesModel`.

    Raises
    ------
    FileError
        If they cannot be read, or one is missing.
    """
    file = folder / (path or samples_path)
    if path:
        return poses_of(file, read_cells(file, COLUMNS))
    return poses_of(file, _arrays_of(file, COLUMNS) if file.suffix.lower() == ".npz" else {})


@contextmanager
def _is_read(file: Path, otherwise: str) -> Iterator[None]:
    """Say in one line why a file cannot be used: there is none, or `otherwise`."""
    try:
        yield
    except FileNotFoundError as error:
        raise FileError(file, "does not exist") from error
    except (OSError, ValueError, EOFError, OverflowError, csv.Error) as error:
        raise FileError(file, otherwise) from error


def _loaded(file: Path) -> Any:
    with _is_read(file, "is not a NumPy file, or damaged"):
        # Not read before it is used: a header can promise terabytes.
        return np.load(file, mmap_mode="r", allow_pickle=False)


def _array_of(file: Path, name: str) -> Any:
    archive = _arrays_of(file, [name])
    if name not in archive:
        raise FileError(file, f"has no array {name!r}, only {', '.join(array_names(file))}")
    return archive[name]


def _arrays_of(file: Path, names: Collection[str]) -> dict[str, NDArray[Any]]:
    try:
        with file_errors(FileError, file, "read"):
            return load_arrays(file, names)
    except ValueError as error:
        raise FileError(file, f"is not a readable NumPy file: {error}") from error


def _read_table(file: Path) -> FloatArray:
    with _is_read(file, "is not a table of numbers with as many in each row"):
        return np.loadtxt(file, delimiter=",", ndmin=2)


def read_cells(file: Path, known: Collection[str]) -> dict[str, list[str]]:
    """Cells of a .csv file by the names in its header, which all are known ones.

    Raises
    ------
    FileError
        If it cannot be read, or holds something else.
    """
    with (
        _is_read(file, "is not a text file with columns"),
        file.open(newline="", encoding="utf-8") as stream,
    ):
        header, *rows = list(csv.reader(stream)) or [[]]
    names = [name.strip() for name in header]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise FileError(file, f"has a column {unknown[0]!r}; known are {', '.join(known)}")
    if any(len(row) != len(names) for row in rows):
        raise FileError(file, "has rows of another length than its header")
    return {name: [row[number] for row in rows] for number, name in enumerate(names)}


def poses_of(file: Path, cells: Mapping[str, Any]) -> dict[str, FloatArray]:
    """Columns of poses among others, those that need not be there with the value they have then.

    Raises
    ------
    FileError
        If one is missing, or they are not numbers.
    """
    columns = {name: _numbers(file, name, cells[name]) for name in COLUMNS if name in cells}
    missing = [name for name in COLUMNS if name not in columns and name not in OPTIONAL]
    if missing:
        raise FileError(file, f"has no {', '.join(missing)} of the poses")
    count = len(columns["time_s"])
    for name, value in OPTIONAL.items():
        columns.setdefault(name, np.full(count, value))
    if any(len(column) != count for column in columns.values()):
        raise FileError(file, "has columns of poses of different lengths")
    return columns


def _numbers(file: Path, name: str, values: Any) -> FloatArray:
    try:
        if np.iscomplexobj(values):
            raise ValueError("has imaginary parts")
        numbers = np.asarray(values, dtype=float)
    except ValueError as error:
        raise FileError(file, f"{name}: is not all numbers") from error
    if numbers.ndim != 1 or not np.all(np.isfinite(numbers)):
        raise FileError(file, f"{name}: must be finite, and one number a ping")
    return numbers


def _read_waves(folder: Path, path: str) -> ReadSamples:
    files = sorted(folder.glob(path))
    if not files:
        raise FileError(folder / path, "does not exist")
    rows, rates = [], set()
    for file in files:
        with _is_read(file, "is not a WAV file, or damaged"):
            rate_hz, values = wavfile.read(file)
        if values.ndim > 1:
            # Two channels are I and Q; of a mono recording on two, either would do.
            values = values[:, 0] + 1j * values[:, 1]
        rows.append(values)
        rates.add(float(rate_hz))
    if len(rates) > 1:
        raise FileError(folder / path, "are files of different sample rates")
    return ReadSamples(rows, rates.pop(), is_continuous=len(files) == 1)
