"""From a description and its files to echo traces."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import ConfigurationError, MalformedMessageError
from usmap_ros.importing.description import Recording
from usmap_ros.importing.files import ReadSamples, read_poses, read_samples
from usmap_ros.importing.sensor import Sensor
from usmap_ros.importing.units import unit_problem
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import EchoTrace

_NANOSECONDS = 1_000_000_000


def imported_traces(path: str | Path) -> Iterator[tuple[str, EchoTrace]]:
    """Yield topic and trace of every ping that a description speaks of.

    Parameters
    ----------
    path : path-like
        The description, a YAML file; see `Recording`.

    Raises
    ------
    ConfigurationError
        If it cannot be true, or something in it looks like another unit.
    FileError
        If its files cannot be used.
    """
    path = Path(path)
    recording = Recording.load(path)
    samples = recording.samples
    if not samples.path:
        raise ConfigurationError(path, "samples.path: is missing")
    read = read_samples(path.parent, samples.path, samples.name)
    poses = read_poses(path.parent, recording.poses.path, samples.path)
    rate_hz = _rate_hz(path, recording, read.rate_hz)
    rows = _pings(path, recording, read, poses["time_s"], rate_hz)
    first = np.concatenate(rows[: min(len(rows), 50)])
    trace_s = max(len(row) for row in rows) / rate_hz
    is_whole = first.dtype.kind in "iu" or bool(np.all(first == np.rint(first.real)))
    largest = float(np.abs(first).max(initial=0.0))
    problem = unit_problem(recording, largest, is_whole, trace_s, rate_hz, poses)
    if problem:
        raise ConfigurationError(path, problem)
    sensor = Sensor(recording, rate_hz)
    for number, row in enumerate(rows):
        at = {name: float(column[number]) for name, column in poses.items()}
        base = Pose.planar(at["x_m"], at["y_m"], at["yaw_rad"], at["z_m"])
        try:
            trace = sensor.trace(row, round(at["time_s"] * _NANOSECONDS), sensor.pose(base))
        except MalformedMessageError as error:
            raise ConfigurationError(path, f"ping at {at['time_s']:g} s: {error}") from error
        yield f"/{recording.robot}/echo", trace


def _rate_hz(path: Path, recording: Recording, read_hz: float) -> float:
    stated_hz = recording.samples.sample_rate_hz
    if not stated_hz and not read_hz:
        raise ConfigurationError(path, "samples.sample_rate_hz: is missing")
    if stated_hz and read_hz and abs(stated_hz - read_hz) > 0.5:
        raise ConfigurationError(
            path, f"samples.sample_rate_hz: is {stated_hz:g} Hz, the WAV file says {read_hz:g}"
        )
    return stated_hz or read_hz


def _pings(
    path: Path, recording: Recording, read: ReadSamples, time_s: FloatArray, rate_hz: float
) -> list[NDArray[Any]]:
    """Samples of each ping, in the form that their encoding has."""
    rows = list(read.rows)
    if read.is_continuous and len(time_s) > 1:
        # Pings begin at their times, the recording at the first of them.
        starts = np.rint((time_s - time_s[0]) * rate_hz).astype(int)
        length = int(np.ceil(2.0 * recording.max_range_m / 330.0 * rate_hz))
        rows = [read.rows[0][start : start + length] for start in starts]
    if len(rows) != len(time_s):
        raise ConfigurationError(
            path, f"samples: has {len(rows)} pings, and the poses are {len(time_s)}"
        )
    if not rows or min(len(row) for row in rows) == 0:
        raise ConfigurationError(path, "samples: has pings without a sample")
    is_iq = recording.samples.encoding == "iq"
    if is_iq and rows[0].dtype.kind != "c":
        if any(len(row) % 2 for row in rows):
            raise ConfigurationError(path, "samples: has rows that are not pairs of I and Q")
        rows = [row[0::2] + 1j * row[1::2] for row in rows]
    elif not is_iq and rows[0].dtype.kind == "c":
        encoding = recording.samples.encoding
        raise ConfigurationError(path, f"samples.encoding: is {encoding}, but samples are complex")
    return rows
