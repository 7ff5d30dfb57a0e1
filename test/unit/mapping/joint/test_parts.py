"""A place is cut where what pings hear changes, and nowhere else."""

from collections.abc import Callable

import numpy as np

from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.joint.surfaces.parts import ALL, any_holds, halves, mirrors_of_parts
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone


def places(count: int, left_m: float, right_m: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.stack([rng.uniform(left_m, right_m, count), rng.uniform(0.0, 4.0, count)], axis=1)


def test_two_rooms_that_answer_otherwise_are_told_apart() -> None:
    rough_m, smooth_m = places(200, 0.0, 4.0, 1), places(100, 4.2, 8.0, 2)
    rng = np.random.default_rng(3)
    loudest = np.exp(rng.normal([1.0] * 200 + [-0.5] * 100, 0.6))
    loudest[::7] = 0.0
    parts = halves(ALL, np.concatenate([rough_m, smooth_m]), loudest)
    assert len(parts) == 2
    in_rough, in_smooth = (max(part.holds(rough_m).mean() for part in parts),
                           max(part.holds(smooth_m).mean() for part in parts))  # fmt: skip
    assert min(in_rough, in_smooth) > 0.95
    assert any_holds(parts, rough_m).all()
    assert not (parts[0].holds(rough_m) & parts[1].holds(rough_m)).any()


def test_one_room_stays_whole() -> None:
    room_m = places(300, 0.0, 8.0, 1)
    loudest = np.exp(np.random.default_rng(4).normal(1.0, 1.0, 300))
    assert halves(ALL, room_m, loudest) == []
    assert halves(ALL, room_m[:50], np.where(room_m[:50, 0] < 4.0, 9.0, 1.0)) == []


def test_what_is_between_the_rooms_is_of_both() -> None:
    """Through a wall of glass beyond the last ping of its room 1 m² was open: bricks answer so."""
    rough_m, smooth_m = places(200, 0.0, 4.0, 1), places(100, 6.0, 8.0, 2)
    loudest = np.concatenate([np.full(200, 3.0), np.full(100, 0.5)])
    parts = halves(ALL, np.concatenate([rough_m, smooth_m]), loudest)
    between_m = np.array([[4.1, 2.0], [5.0, 0.0], [5.9, 2.0]])
    assert [part.holds(between_m).tolist() for part in parts] == [[True] * 3] * 2
    assert sorted(part.holds(rough_m).mean() for part in parts) == [0.0, 1.0]
    assert sorted(part.holds(smooth_m).mean() for part in parts) == [0.0, 1.0]


def test_pings_of_one_place_are_not_cut_apart() -> None:
    standing_m, beside_m = np.tile([[1.0, 1.0]], (200, 1)), places(100, 2.0, 4.0, 5)
    loudest = np.concatenate([np.tile([9.0, 0.1], 100), np.full(100, 0.05)])
    parts = halves(ALL, np.concatenate([standing_m, beside_m]), loudest)
    assert sorted(part.holds(standing_m).mean() for part in parts) == [0.0, 1.0]


def test_parts_are_cut_again_within_their_edges() -> None:
    left, right = ALL.beside(np.array([1.0, 0.0]), 3.5, 4.5)
    low, high = left.beside(np.array([0.0, 1.0]), 2.0, 2.0)
    points_m = np.array([[1.0, 1.0], [1.0, 3.0], [5.0, 1.0], [4.0, 1.0]])
    assert [part.holds(points_m).tolist() for part in (low, high, right)] == [
        [True, False, False, True], [False, True, False, False], [False, False, True, True],
    ]  # fmt: skip


def test_the_quieter_part_may_have_mirrors_that_are_too_few_to_tell(
    make_cone: Callable[..., EchoCone],
) -> None:
    """A robot between walls of glass was taken for deaf, for it heard nothing of the bricks."""
    kept, rng = KeptPings(MappingParameters()), np.random.default_rng(6)
    for number, (x_m, y_m) in enumerate(places(160, 0.0, 6.0, 7)):
        loud = 0.4 if x_m < 3.0 else 0.02
        near_m, far_m = rng.uniform([0.5, 1.6], [1.4, 2.5])
        pose = {"x_m": x_m, "y_m": y_m, "yaw_rad": x_m}
        kept.add(make_cone((near_m, loud), (far_m, loud), stamp_ns=number, **pose), "robot")
    table, pings, _, echoes, first_only, _ = kept.pings()
    nothing = np.zeros(len(echoes.range_m), bool)
    found, mirrored = mirrors_of_parts(table, pings, echoes, nothing, ~nothing, first_only)
    assert not found
    assert [part.holds(np.array([[0.5, 1.0], [5.5, 1.0]])).tolist() for part in mirrored] == [
        [False, True]
    ]
