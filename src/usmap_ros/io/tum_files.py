"""Trajectories as TUM files, which evo and most tools of visual SLAM read.

A line is a stamp in seconds, x, y, z in metres and a quaternion x, y, z, w; lines that begin with
``#`` are comments (https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats).
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from usmap_ros import bounds
from usmap_ros.errors import FileError, file_errors
from usmap_ros.io.atomic import write_atomically
from usmap_ros.numerics.geometry import QUATERNION_TOLERANCE
from usmap_ros.pings.trajectory import Trajectory

SUFFIX = ".tum"
_COLUMNS = 8
#: A file that is larger than this is none of a trajectory, bytes.
_LARGEST = 500_000_000


class TrajectoryFileError(FileError):
    """A trajectory that cannot be read or written."""


def save_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Write a TUM file in one step.

    Raises
    ------
    TrajectoryFileError
        If it cannot be written.
    """
    lines = ["# timestamp_s x_m y_m z_m qx qy qz qw\n"]
    rows = zip(
        trajectory.stamps_ns.tolist(),
        trajectory.positions_m.tolist(),
        trajectory.orientations.tolist(),
        strict=True,
    )
    for stamp_ns, position, orientation in rows:
        numbers = " ".join(f"{value:.9g}" for value in [*position, *orientation])
        # By integers: as a float a stamp is off by a quarter of a microsecond.
        lines.append(f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d} {numbers}\n")
    with file_errors(TrajectoryFileError, path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, "".join(lines).encode("ascii"))


def load_trajectory(path: Path) -> Trajectory:
    """Read a TUM file.

    Raises
    ------
    TrajectoryFileError
        If there is none, or a line of it is no pose.
    """
    try:
        with file_errors(TrajectoryFileError, path, "read"):
            if path.stat().st_size > _LARGEST:
                raise TrajectoryFileError(path, f"has more than {_LARGEST} bytes")
            text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise TrajectoryFileError(path, "is no text") from error
    stamps_ns, rows = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.split()
        if not fields or fields[0].startswith("#"):
            continue
        try:
            stamps_ns.append(_nanoseconds(fields[0]))
            rows.append([float(field) for field in fields[1:]])
        except (ValueError, OverflowError) as error:
            raise TrajectoryFileError(path, f"line {number} has what is no number") from error
        if len(fields) != _COLUMNS:
            raise TrajectoryFileError(path, f"line {number} has {len(fields)} of 8 numbers")
    return _trajectory(path, np.array(stamps_ns, np.int64), np.array(rows).reshape(-1, 7))


def _trajectory(path: Path, stamps_ns: np.ndarray, rows: np.ndarray) -> Trajectory:
    if not len(rows):
        raise TrajectoryFileError(path, "holds no pose")
    norms = np.linalg.norm(rows[:, 3:], axis=1)
    if not np.isfinite(rows).all() or np.abs(rows[:, :3]).max() > bounds.POSITION.greatest:
        raise TrajectoryFileError(path, "holds a position that is not finite, or too far away")
    if np.abs(norms - 1.0).max() > QUATERNION_TOLERANCE:
        raise TrajectoryFileError(path, "holds a quaternion whose norm is not 1")
    order = np.argsort(stamps_ns, kind="stable")
    rows[:, 3:] /= norms[:, np.newaxis]
    return Trajectory(stamps_ns[order], rows[order, :3], rows[order, 3:])


def _nanoseconds(text: str) -> int:
    """A stamp in seconds as it is written, without the rounding of a float where it has none."""
    whole, _, part = text.partition(".")
    if whole.isdecimal() and (part.isdecimal() or not part):
        stamp_ns = int(whole) * 10**9 + int(f"{part:0<9}"[:9])
    else:
        stamp_ns = round(float(text) * 1e9)
    if abs(stamp_ns) >= 2**63:
        raise OverflowError(text)
    return stamp_ns


def file_name(topic: str) -> str:
    """Name of the file of a topic's trajectory: ``robot1.echo.tum`` of ``/robot1/echo``."""
    # No name of a topic holds a dot.
    return topic.strip("/").replace("/", ".") + SUFFIX


def save_trajectories(folder: Path, trajectories: Mapping[str, Trajectory]) -> None:
    """Write a TUM file of each topic into a folder, in which there are no others then.

    Raises
    ------
    TrajectoryFileError
        If one cannot be written.
    """
    for old in folder.glob(f"*{SUFFIX}"):
        if old.name not in map(file_name, trajectories):
            old.unlink(missing_ok=True)
    for topic, trajectory in trajectories.items():
        save_trajectory(folder / file_name(topic), trajectory)


def load_trajectories(path: Path) -> dict[str, Trajectory]:
    """Trajectories of a file, or of all TUM files in a folder, by the names of the files.

    Raises
    ------
    TrajectoryFileError
        If there is none, or one cannot be read.
    """
    if not path.is_dir():
        return {path.name: load_trajectory(path)}
    found = {file.name: load_trajectory(file) for file in sorted(path.glob(f"*{SUFFIX}"))}
    if not found:
        raise TrajectoryFileError(path, f"holds no file *{SUFFIX}")
    return found
