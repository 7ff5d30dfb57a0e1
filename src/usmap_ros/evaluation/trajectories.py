"""How far paths are off: absolute and relative pose errors, as evo defines them.

The absolute error (ATE, evo's APE) compares places one by one; the relative one (RPE) compares
changes from one pose to the next, so that it does not add up.  Sturm et al., A benchmark for the
evaluation of RGB-D SLAM systems, IROS 2012; https://github.com/MichaelGrupp/evo.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from usmap_ros.errors import UsmapError
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.trajectory import Trajectory

#: Poses whose stamps differ by no more are those of one moment: evo's default.
_SAME_MOMENT_NS = 10_000_000


@dataclass(frozen=True)
class PathScore:
    """How far a path is off."""

    #: How many were compared.
    poses: int
    #: Root mean square of the distances.
    ate_m: float
    #: The largest of them.
    ate_max_m: float
    #: Root mean square of the angles between orientations.
    ate_rad: float
    #: Root mean square of the errors of changes from pose to pose; NaN of a single pose.
    rpe_m: float
    rpe_rad: float


def score_paths(
    estimates: Mapping[str, Trajectory], truths: Mapping[str, Trajectory], *, aligned: bool = False
) -> dict[str, PathScore]:
    """Compare each path with the truth.

    Parameters
    ----------
    estimates : mapping of str to Trajectory
        Path of each robot as the map has it, by the robot's name.
    truths : mapping of str to Trajectory
        By the same names; a single one may have any, and hold the poses of several paths, which
        are told apart by their stamps.
    aligned : bool
        Lay all paths together over the truth first, as one stiff body.

    Raises
    ------
    UsmapError
        If a path has no truth, or none at the times of its poses.
    """
    pairs = {}
    for name, estimate in estimates.items():
        truth = truths.get(name)
        if truth is None and len(truths) == 1:
            truth = next(iter(truths.values()))
        if truth is None:
            raise UsmapError(f"of {name} there is no true path; there are {', '.join(truths)}")
        pairs[name] = associate(estimate, truth)
        if not len(pairs[name][0]):
            raise UsmapError(f"{name} has no pose within 10 ms of one of its true path")
    if aligned:
        pairs = _aligned(pairs)
    return {name: score_path(*pair) for name, pair in pairs.items()}


def associate(estimate: Trajectory, truth: Trajectory) -> tuple[Trajectory, Trajectory]:
    """Poses of both that are of the same moments."""
    after = np.searchsorted(truth.stamps_ns, estimate.stamps_ns)
    near = np.stack([np.clip(after - 1, 0, None), np.clip(after, None, len(truth) - 1)])
    apart_ns = np.abs(truth.stamps_ns[near] - estimate.stamps_ns)
    nearest = near[np.argmin(apart_ns, axis=0), np.arange(len(estimate))]
    found = np.flatnonzero(apart_ns.min(axis=0) <= _SAME_MOMENT_NS)
    return estimate.at(found), truth.at(nearest[found])


def score_path(estimate: Trajectory, truth: Trajectory) -> PathScore:
    """Compare poses one by one; both have as many, at least one."""
    distances_m = np.linalg.norm(estimate.positions_m - truth.positions_m, axis=1)
    turns, true_turns = (Rotation.from_quat(path.orientations) for path in (estimate, truth))
    steps_m = steps_rad = np.zeros(0)
    if len(estimate) > 1:
        ways_m, changes = _steps(estimate, turns)
        true_ways_m, true_changes = _steps(truth, true_turns)
        steps_m = np.linalg.norm(ways_m - true_ways_m, axis=1)
        steps_rad = _angles(changes, true_changes)
    return PathScore(
        len(estimate),
        _rms(distances_m),
        float(distances_m.max()),
        _rms(_angles(turns, true_turns)),
        _rms(steps_m),
        _rms(steps_rad),
    )


def _angles(turns: Rotation, true_turns: Rotation) -> FloatArray:
    """How far turns are from others, rad."""
    return np.asarray((true_turns.inv() * turns).magnitude())


def _steps(path: Trajectory, turns: Rotation) -> tuple[FloatArray, Rotation]:
    """Ways (m), and turns, from each pose to the next, as seen from there."""
    back = turns[:-1].inv()
    return back.apply(np.diff(path.positions_m, axis=0)), back * turns[1:]


def _aligned(
    pairs: Mapping[str, tuple[Trajectory, Trajectory]],
) -> dict[str, tuple[Trajectory, Trajectory]]:
    """Paths turned and shifted as one, so that squared distances are least (Umeyama 1991)."""
    ours = np.concatenate([estimate.positions_m for estimate, _ in pairs.values()])
    true = np.concatenate([truth.positions_m for _, truth in pairs.values()])
    left, _, right = np.linalg.svd((true - true.mean(axis=0)).T @ (ours - ours.mean(axis=0)))
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    turn = left @ mirror @ right
    shift = true.mean(axis=0) - turn @ ours.mean(axis=0)
    return {
        name: (_moved(estimate, turn, shift), truth) for name, (estimate, truth) in pairs.items()
    }


def _moved(path: Trajectory, turn: FloatArray, shift_m: FloatArray) -> Trajectory:
    orientations = (Rotation.from_matrix(turn) * Rotation.from_quat(path.orientations)).as_quat()
    return Trajectory(path.stamps_ns, path.positions_m @ turn.T + shift_m, orientations)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")
