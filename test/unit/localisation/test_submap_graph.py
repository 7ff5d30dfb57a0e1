"""Ways that are brought in line by where their submaps lie over each other."""

import numpy as np

from usmap_ros.localisation.planar import between, compose
from usmap_ros.localisation.submap_graph import Edge, in_line
from usmap_ros.localisation.tracks import Track

PINGS, EVERY = 200, 25


def true_way(turn_rad: float) -> np.ndarray:
    """Along a circle, from some place on it on."""
    angle_rad = np.linspace(0.0, 1.5 * np.pi, PINGS) + turn_rad
    return np.stack([2.0 * np.sin(angle_rad), -2.0 * np.cos(angle_rad), angle_rad], axis=-1)


def drifting(true: np.ndarray, turned_rad: float) -> Track:
    """As a robot has it whose heading drifts by so much, evenly along the way."""
    steps = between(true[:-1], true[1:])
    steps[:, 2] += turned_rad / (PINGS - 1)
    told = [true[0]]
    for step in steps:
        told.append(compose(told[-1], step))
    known = np.linspace(1e-6, 1.0, PINGS)[:, np.newaxis, np.newaxis] * np.diag([0.01, 0.01, 0.02])
    return Track(np.arange(PINGS), np.array(told), known, np.zeros(PINGS, np.int64), EVERY)


TRUE = [true_way(0.0), true_way(1.0)]
TRACKS = [drifting(TRUE[0], 0.2), drifting(TRUE[1], -0.15)]


def edge(one: int, other: int, off: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Edge:
    """Of a knot of the second way as seen from one of the first way."""
    ends = (
        true[track.knots[knot]]
        for true, track, knot in zip(TRUE, TRACKS, (one, other), strict=True)
    )
    return Edge((0, one), (1, other), compose(between(*ends), np.array(off)))


def off_m(edges: list[Edge]) -> float:
    """How far poses are off, wherever they lie as a whole (RMS)."""
    found, true = (
        np.concatenate(poses)[:, :2] @ [1.0, 1.0j] for poses in (in_line(TRACKS, edges), TRUE)
    )
    found, true = found - found.mean(), true - true.mean()
    turn = np.vdot(found, true) / abs(np.vdot(found, true))
    return float(np.sqrt(np.mean(np.abs(turn * found - true) ** 2)))


def right_edges() -> list[Edge]:
    last = min(len(track.knots) for track in TRACKS) - 1
    return [edge(one, one + step) for step in (-1, 0, 1) for one in range(1, last)]


def test_ways_without_edges_stay_as_robots_have_them() -> None:
    for track, poses in zip(TRACKS, in_line(TRACKS, []), strict=True):
        np.testing.assert_allclose(poses[:, :2], track.told[:, :2], atol=1e-6)


def test_ways_come_in_line_where_submaps_lie_over_each_other() -> None:
    assert off_m([]) > 0.1
    assert off_m(right_edges()) < 0.06


def test_a_wrong_closure_that_is_forced_into_the_graph_does_not_bend_it() -> None:
    right, closures = right_edges(), ((2.0, -1.0, 1.0), (0.8, 0.0, 0.0), (0.0, 0.0, 3.1))
    for off in closures:
        assert off_m([*right, edge(2, 5, off)]) < off_m(right) + 0.01


def test_a_long_way_that_comes_back_again_and_again_is_brought_in_line() -> None:
    # 2,000 knots, each seen from the one a round before: dense equations of them are 288 MB.
    rounds, knots = 100, 20
    turns_rad = np.linspace(0.0, 2.0 * np.pi * rounds, rounds * knots + 1)
    true = np.stack([3.0 * np.sin(turns_rad), -3.0 * np.cos(turns_rad), turns_rad], axis=-1)
    steps = between(true[:-1], true[1:])
    steps[:, 2] += 0.004
    told = [true[0]]
    for step in steps:
        told.append(compose(told[-1], step))
    count = len(told)
    known = np.arange(1, count + 1)[:, np.newaxis, np.newaxis] * np.diag([1e-4, 1e-4, 1e-3])
    way = Track(np.arange(count), np.array(told), known, np.zeros(count, np.int64), 1)
    assert len(way.knots) == count
    edges = [
        Edge((0, at), (0, at + knots), between(true[at], true[at + knots]))
        for at in range(count - knots)
    ]
    (poses,) = in_line([way], edges)
    assert np.abs(way.told[:, :2] - true[:, :2]).max() > 1.0
    assert np.abs(poses[:, :2] - true[:, :2]).max() < 0.3
