"""What is undecided, and which ping would settle it."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.grids import AMBIGUITY, GridGeometry, OccupancyMap
from usmap_ros.mapping.joint.drawing import undecided
from usmap_ros.mapping.next_view import best_views, candidate_poses, view_scores
from usmap_ros.numerics.geometry import Pose
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import hear
from usmap_ros.simulation.points import RECEIVER

POLE = (1.54, 0.437)
MIRROR = (POLE[0], -POLE[1])
NOISY = replace(RECEIVER, noise_std=0.01)
SONAR = Transducer(Pulse(PulseShape.HANN_BURST, 50e3, 3e-4), BeamPattern.linear(), 0.2, 4.0)
SIDES = [
    (0.0, 0.0, 0.0), (0.3, 0.9, -0.5), (1.6, 1.7, -1.6), (1.5, -1.0, 1.5), (3.2, 0.3, 3.0),
    (2.9, -0.9, 2.6), (2.9, 1.1, -2.5), (0.4, -0.6, 0.8),
]  # fmt: skip


def mapped(*poses: tuple[float, float, float]) -> OccupancyMap:
    """Map of a pole that was heard from these poses."""
    pipeline = Pipeline()
    for seed, pose in enumerate(poses):
        pipeline.process(hear([POLE], 0.7, pose=Pose.planar(*pose), receiver=NOISY, seed=seed))
    return pipeline.occupancy_map()


def near(occupancy: OccupancyMap, place: tuple[float, float]) -> float:
    """Greatest ambiguity within one cell of a place."""
    first = np.array(occupancy.geometry.first_cell)
    column, row = np.floor(np.array(place) / occupancy.geometry.resolution_m).astype(int) - first
    padded = np.pad(occupancy.layers[AMBIGUITY], 1)
    return float(padded[row : row + 3, column : column + 3].max(initial=0.0))


@pytest.fixture(scope="module")
def one_ping() -> OccupancyMap:
    return mapped(SIDES[0])


@pytest.fixture(scope="module")
def many_sides() -> OccupancyMap:
    return mapped(*SIDES)


def test_after_one_ping_pole_and_mirror_image_are_undecided(one_ping: OccupancyMap) -> None:
    assert near(one_ping, POLE) > 0.4
    assert near(one_ping, MIRROR) == pytest.approx(near(one_ping, POLE), abs=1e-3)


def test_only_the_ring_is_suspected(one_ping: OccupancyMap) -> None:
    rows, columns = np.nonzero(one_ping.layers[AMBIGUITY])
    range_m = np.hypot(*one_ping.geometry.cell_centers_m(rows, columns).T)
    np.testing.assert_allclose(range_m, np.hypot(*POLE), atol=0.13)
    percent = one_ping.ambiguity_percent()
    assert percent.max() > 40
    np.testing.assert_array_equal(
        percent == -1, ~one_ping.observed & (one_ping.layers[AMBIGUITY] == 0.0)
    )


def test_seen_from_several_sides_a_pole_is_decided(many_sides: OccupancyMap) -> None:
    assert near(many_sides, POLE) < 0.1
    assert near(many_sides, MIRROR) < 0.1
    assert many_sides.layers[AMBIGUITY].max() < 0.2


def test_around_what_is_decided_nothing_is_undecided(many_sides: OccupancyMap) -> None:
    rows, columns = np.nonzero(many_sides.predicted())
    assert len(rows) > 0
    padded = np.pad(many_sides.layers[AMBIGUITY], 1)
    around = [
        padded[row : row + 3, column : column + 3].max()
        for row, column in zip(rows, columns, strict=True)
    ]
    assert max(around) < 0.1


def test_shared_echoes_are_undecided_unless_evidence_has_decided() -> None:
    explained = np.array([[0.0, 0.1, 0.5, 1.0, 1.2, 0.1]], np.float32)
    belief = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]], np.float32)
    expected = [[0.0, 0.469, 1.0, 0.0, 0.0, 0.0]]
    np.testing.assert_allclose(undecided(explained, belief), expected, atol=1e-3)


def test_a_view_from_the_side_settles_more_than_the_same_again(one_ping: OccupancyMap) -> None:
    again, opposite = (0.0, 0.0, 0.0), (3.2, 0.0, np.pi)
    left, right = (1.55, 1.5, -0.5 * np.pi), (1.55, -1.5, 0.5 * np.pi)
    poses = np.array([again, opposite, left, right])
    scores = view_scores(one_ping, poses, SONAR)
    assert scores[2:].min() > 2.0 * scores[:2].max()
    (best,) = best_views(one_ping, poses, SONAR, count=1)
    assert (best.x_m, best.y_m) in {(1.55, 1.5), (1.55, -1.5)}
    assert best.score == scores.max()


def room(layer: np.ndarray, believed: np.ndarray) -> OccupancyMap:
    log_odds = np.where(believed, 3.0, -3.0).astype(np.float32)
    geometry = GridGeometry(0.1, (0.0, 0.0), (40, 40))
    return OccupancyMap(
        geometry, log_odds, np.ones((40, 40), bool), "map", layers={AMBIGUITY: layer}
    )


def test_what_is_behind_a_wall_or_out_of_reach_settles_nothing() -> None:
    ambiguity, wall = np.zeros((40, 40), np.float32), np.zeros((40, 40), bool)
    ambiguity[20, 30] = 1.0
    poses = np.array([[1.05, 2.05, 0.0], [1.05, 2.05, np.pi], [3.05, 3.55, -0.5 * np.pi]])
    in_the_open = view_scores(room(ambiguity, wall), poses, SONAR)
    assert in_the_open[0] > 0.3
    assert in_the_open[1] == 0.0
    wall[15:25, 20] = True
    behind = view_scores(room(ambiguity, wall), poses, SONAR)
    assert behind[0] == 0.0
    assert behind[2] == in_the_open[2] > 0.3
    near_sighted = replace(SONAR, max_range_m=1.0)
    assert not view_scores(room(ambiguity, wall), poses, near_sighted).any()


def test_candidates_are_free_and_keep_their_distance() -> None:
    wall = np.zeros((40, 40), bool)
    wall[:, 20] = True
    occupancy = room(np.zeros((40, 40), np.float32), wall)
    observed = occupancy.observed.copy()
    observed[:20] = False
    poses = candidate_poses(replace(occupancy, observed=observed), headings=4)
    assert len(poses) > 0
    assert (np.abs(poses[:, 0] - 2.05) >= 0.3 - 1e-9).all()
    assert (poses[:, 1] > 2.0).all()
    assert len(np.unique(poses[:, 2])) == 4


def test_best_views_lie_apart_and_come_best_first() -> None:
    ambiguity = np.zeros((40, 40), np.float32)
    ambiguity[18:22, 18:22] = 1.0
    occupancy = room(ambiguity, np.zeros((40, 40), bool))
    views = best_views(occupancy, candidate_poses(occupancy), SONAR, count=3, apart_m=1.0)
    assert len(views) == 3
    assert [view.score for view in views] == sorted((v.score for v in views), reverse=True)
    places = np.array([(view.x_m, view.y_m) for view in views])
    distances = np.hypot(*(places[:, None] - places[None]).T)
    assert distances[~np.eye(3, dtype=bool)].min() >= 1.0


def test_a_map_without_ambiguity_cannot_be_planned_on() -> None:
    occupancy = replace(room(np.zeros((40, 40), np.float32), np.zeros((40, 40), bool)), layers={})
    with pytest.raises(ValueError, match="has no layer ambiguity"):
        best_views(occupancy, np.zeros((1, 3)), SONAR)
