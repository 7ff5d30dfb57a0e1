"""Trajectories as TUM files."""

from pathlib import Path

import numpy as np
import pytest

from usmap_ros.io.tum_files import (
    TrajectoryFileError,
    file_name,
    load_trajectories,
    load_trajectory,
    save_trajectories,
)
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trajectory import Trajectory

STAMPS_NS = np.array([1_700_000_000_123_456_789, 1_700_000_001_000_000_001])
PATH = Trajectory.planar(STAMPS_NS, np.array([[1.0, 2.0, 0.5], [-3.0, 4.0, -2.0]]))


def test_what_was_written_is_read(tmp_path: Path) -> None:
    save_trajectories(tmp_path / "paths", {"/robot1/echo": PATH, "/robot2/left/echo": PATH})
    found = load_trajectories(tmp_path / "paths")
    assert list(found) == ["robot1.echo.tum", "robot2.left.echo.tum"]
    again = found[file_name("/robot1/echo")]
    np.testing.assert_array_equal(again.stamps_ns, STAMPS_NS)
    np.testing.assert_allclose(again.positions_m, PATH.positions_m)
    np.testing.assert_allclose(again.orientations, PATH.orientations, atol=1e-8)


def test_stamps_as_other_programs_write_them(tmp_path: Path) -> None:
    (tmp_path / "a.tum").write_text("# t x y z\n\n1.7e9 0 0 0 0 0 0 1\n1.5 1 0 0 0 0 1 0\n")
    path = load_trajectory(tmp_path / "a.tum")
    # In the order of their stamps.
    assert path.stamps_ns.tolist() == [1_500_000_000, 1_700_000_000 * 10**9]


def test_poses_come_in_the_order_of_their_stamps() -> None:
    poses = [(3, Pose.planar(3.0, 0.0, 0.0)), (1, Pose.planar(1.0, 0.0, 0.0))]
    again = (3, Pose.planar(9.0, 0.0, 0.0))
    path = Trajectory.of_poses([*poses, again])
    assert path.stamps_ns.tolist() == [1, 3]
    assert path.positions_m[:, 0].tolist() == [1.0, 3.0]


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("", "no pose"),
        ("1 0 0 0 0 0 0\n", "line 1 has 7 of 8"),
        ("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 x\n", "line 2 has what is no number"),
        ("1 0 0 nan 0 0 0 1\n", "not finite"),
        ("1 0 1e9 0 0 0 0 1\n", "too far"),
        ("1 0 0 0 0 0 0 2\n", "norm"),
        ("1e30 0 0 0 0 0 0 1\n", "no number"),
    ],
)
def test_what_is_no_trajectory_is_refused(tmp_path: Path, text: str, cause: str) -> None:
    (tmp_path / "a.tum").write_text(text)
    with pytest.raises(TrajectoryFileError, match=cause):
        load_trajectory(tmp_path / "a.tum")


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(TrajectoryFileError, match=r"no\.tum: does not exist"):
        load_trajectories(tmp_path / "no.tum")
    with pytest.raises(TrajectoryFileError, match=r"holds no file \*\.tum"):
        load_trajectories(tmp_path)
