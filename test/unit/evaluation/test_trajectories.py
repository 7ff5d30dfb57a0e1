"""How far paths are off, as evo says it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from usmap_ros.errors import UsmapError
from usmap_ros.evaluation.trajectories import associate, score_path, score_paths
from usmap_ros.pings.trajectory import Trajectory

START_NS = 1_700_000_000 * 10**9


def paths() -> tuple[Trajectory, Trajectory]:
    """What was told and what is true, of a robot on an ellipse."""
    rng, count = np.random.default_rng(7), 50
    stamps_ns = START_NS + 10**8 * np.arange(count)
    along = np.linspace(0.0, 5.0, count)
    true = np.column_stack([2.0 * np.cos(along), 1.5 * np.sin(along), along + np.pi / 2.0])
    drift = np.cumsum(rng.normal(0.0, 0.01, (count, 3)) * [1.0, 1.0, 0.0], axis=0)
    turned = np.cumsum(rng.normal(0.0, 0.01, count))
    told = true + np.column_stack([drift[:, :2], turned])
    return Trajectory.planar(stamps_ns, told), Trajectory.planar(stamps_ns, true)


def test_errors_are_those_of_evo() -> None:
    """Figures of evo 1.38.1 for the same paths as TUM files.

    ``evo_ape tum`` and ``evo_rpe tum``, with ``-r angle_rad`` for angles.
    """
    score = score_path(*paths())
    assert score.ate_m == pytest.approx(0.123705, abs=1e-6)
    assert score.ate_max_m == pytest.approx(0.200027, abs=1e-6)
    assert score.ate_rad == pytest.approx(0.063147, abs=1e-6)
    assert score.rpe_m == pytest.approx(0.014744, abs=1e-6)
    assert score.rpe_rad == pytest.approx(0.008294, abs=1e-6)


def test_aligned_errors_are_those_of_evo() -> None:
    """As ``evo_ape tum -a`` says it of the same files."""
    told, true = paths()
    score = score_paths({"a": told}, {"a": true}, aligned=True)["a"]
    assert score.ate_m == pytest.approx(0.045655, abs=1e-6)
    assert score.ate_max_m == pytest.approx(0.113880, abs=1e-6)


def test_a_path_that_is_only_turned_and_shifted_is_right_once_it_is_aligned() -> None:
    _, true = paths()
    turn = Rotation.from_euler("z", 0.7)
    other = Trajectory(
        true.stamps_ns,
        turn.apply(true.positions_m) + np.array([3.0, -1.0, 0.0]),
        (turn * Rotation.from_quat(true.orientations)).as_quat(),
    )
    score = score_paths({"a": other}, {"a": true}, aligned=True)["a"]
    assert score.ate_m == pytest.approx(0.0, abs=1e-9)
    assert score.ate_rad == pytest.approx(0.0, abs=1e-7)
    assert score_path(other, true).rpe_m == pytest.approx(0.0, abs=1e-9)


def test_several_paths_are_aligned_as_one() -> None:
    told, true = paths()
    beside_m = true.positions_m + np.array([1.0, 0.0, 0.0])
    apart = Trajectory(told.stamps_ns, beside_m, true.orientations)
    scores = score_paths({"a": true, "b": apart}, {"a": true, "b": true}, aligned=True)
    assert scores["a"].ate_m == pytest.approx(0.5, abs=0.01)


def test_poses_of_other_moments_do_not_count() -> None:
    told, true = paths()
    shifted = Trajectory(told.stamps_ns + 9_000_000, told.positions_m, told.orientations)
    ours, theirs = associate(shifted, true.at(np.arange(20)))
    assert len(ours) == len(theirs) == 20
    late = Trajectory(told.stamps_ns + 30_000_000, told.positions_m, told.orientations).at(
        np.array([49])
    )
    with pytest.raises(UsmapError, match="within 10 ms"):
        score_paths({"a": late}, {"a": true})


def test_a_single_file_may_hold_the_truth_of_several() -> None:
    told, true = paths()
    even, odd = np.arange(0, 50, 2), np.arange(1, 50, 2)
    scores = score_paths({"a": told.at(even), "b": told.at(odd)}, {"all.tum": true})
    assert {name: score.poses for name, score in scores.items()} == {"a": 25, "b": 25}


def test_a_path_without_truth_is_named() -> None:
    told, true = paths()
    with pytest.raises(UsmapError, match="of c there is no true path; there are a, b"):
        score_paths({"c": told}, {"a": true, "b": true})


def test_a_single_pose_has_no_changes() -> None:
    told, true = paths()
    score = score_path(told.at(np.array([3])), true.at(np.array([3])))
    assert score.poses == 1
    assert np.isnan(score.rpe_m)
