"""From a table of ranges to echo cones: sensors that measure a range only."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from usmap_ros.errors import ConfigurationError, FileError, MalformedMessageError
from usmap_ros.importing.files import COLUMNS, poses_of, read_cells
from usmap_ros.importing.units import pose_problems
from usmap_ros.io.yaml_files import load_yaml
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ParameterGroup, quantity
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.range_cones import RangeReading
from usmap_ros.simulation.models.transducers import MountModel


class RangeRecording(ParameterGroup):
    """Ranges, poses and sensors of one robot."""

    robot: str = quantity("robot1", "First part of the topic.", pattern=r"^[A-Za-z]\w*$")
    frame_id: str = quantity(
        "map", "World frame of the poses; ROBOT/odom if they are odometry, which drifts.",
        min_length=1,
    )  # fmt: skip
    ranges: str = quantity(
        ...,
        "A .csv file with a row for each pose and a header: time_s, x_m, y_m, yaw_rad, perhaps z_m,"
        " and a column of ranges (m) for each sensor. An empty cell: it did not measure; inf, or"
        " max_range_m or more: nothing was there. Relative to this file.",
        min_length=1,
    )
    sensors: dict[str, MountModel] = quantity(
        ..., "By the names of their columns, where the sensors sit on the robot.", min_length=1
    )
    field_of_view_rad: float = quantity(..., "Full angle of a beam.", "rad", gt=0.0, le=np.pi)
    min_range_m: float = quantity(..., "Nearest range that is measured.", "m", ge=0.0, le=200.0)
    max_range_m: float = quantity(..., "Largest one.", "m", gt=0.0, le=200.0)


def imported_ranges(path: str | Path) -> Iterator[tuple[str, EchoCone]]:
    """Yield topic and cone of every reading that a description of ranges speaks of.

    Parameters
    ----------
    path : path-like
        The description, a YAML file; see `RangeRecording`.

    Raises
    ------
    ConfigurationError
        If it cannot be true, or something in it looks like another unit.
    FileError
        If its file cannot be used.
    """
    path = Path(path)
    recording = load_yaml(path, RangeRecording)
    file = path.parent / recording.ranges
    cells = read_cells(file, [*COLUMNS, *recording.sensors])
    poses = poses_of(file, cells)
    measured = {name: _ranges(file, name, cells) for name in recording.sensors}
    _check(path, recording, measured, list(pose_problems(poses)))
    mounts = {name: mount.build() for name, mount in recording.sensors.items()}
    for row in np.argsort(poses["time_s"], kind="stable").tolist():
        at = {name: float(column[row]) for name, column in poses.items()}
        base = Pose.planar(at["x_m"], at["y_m"], at["yaw_rad"], at["z_m"])
        for name, ranges_m in measured.items():
            # A sensor says zero, or something too near, for want of an echo.
            if np.isnan(ranges_m[row]) or ranges_m[row] < recording.min_range_m:
                continue
            reading = RangeReading(
                round(at["time_s"] * 1e9), f"{recording.robot}/{name}",
                recording.field_of_view_rad, recording.min_range_m, recording.max_range_m,
                float(ranges_m[row]),
            )  # fmt: skip
            try:
                cone = reading.cone(base.compose(mounts[name]), recording.frame_id)
            except MalformedMessageError as error:
                raise ConfigurationError(path, f"{name} at {at['time_s']:g} s: {error}") from error
            yield f"/{recording.robot}/cone", cone


def _ranges(file: Path, name: str, cells: dict[str, list[str]]) -> FloatArray:
    if name not in cells:
        raise FileError(file, f"has no column {name!r}, which is a sensor's")
    try:
        return np.array([float(cell) if cell.strip() else np.nan for cell in cells[name]])
    except ValueError as error:
        raise FileError(file, f"{name}: is not all numbers") from error


def _check(
    path: Path, recording: RangeRecording, measured: dict[str, FloatArray], problems: list[str]
) -> None:
    """Refuse what cannot be meant as it stands."""
    found_m = np.concatenate(list(measured.values()))
    found_m = found_m[np.isfinite(found_m) & (found_m > 0.0)]
    if not len(found_m):
        problems.append("ranges: there are none")
    elif np.median(found_m) > 2.0 * recording.max_range_m:
        problems.append(
            f"ranges: half of them are beyond {np.median(found_m):g} m, though max_range_m is"
            f" {recording.max_range_m:g}; centimetres? then divide them by 100"
        )
    if problems:
        raise ConfigurationError(path, problems[0])
