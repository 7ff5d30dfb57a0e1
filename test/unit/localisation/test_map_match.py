"""Maps laid over each other, whose frames nobody relates."""

import numpy as np
import pytest

from usmap_ros.grids import GridGeometry, OccupancyMap
from usmap_ros.localisation import Match, match_maps
from usmap_ros.localisation.submap import Submap, in_common
from usmap_ros.localisation.submap_match import promising_by_submaps
from usmap_ros.localisation.way_match import match_way

RESOLUTION_M = 0.05
Segment = tuple[tuple[float, float], tuple[float, float]]
#: A room of 6 m x 4 m, its half turn being the same; and what makes one of its ends another.
WALLS: list[Segment] = [
    ((0.0, 0.0), (6.0, 0.0)), ((6.0, 0.0), (6.0, 4.0)), ((6.0, 4.0), (0.0, 4.0)),
    ((0.0, 4.0), (0.0, 0.0)),
]  # fmt: skip
POLES = [(1.0, 1.1), (1.8, 3.2), (2.9, 0.9), (3.3, 2.6), (4.1, 1.7), (2.2, 2.1), (4.9, 3.1)]
NICHE: list[Segment] = [((0.0, 1.4), (1.3, 1.4)), ((1.3, 1.4), (1.3, 0.5))]


def along(walls: list[Segment]) -> np.ndarray:
    """Points on walls, 3 cm apart."""
    return np.concatenate(
        [
            np.linspace(start, end, int(np.hypot(*np.subtract(end, start)) / 0.03))
            for start, end in walls
        ]
    )


def turned(places_m: np.ndarray, change: np.ndarray) -> np.ndarray:
    cosine, sine = np.cos(change[2]), np.sin(change[2])
    return places_m @ np.array([[cosine, sine], [-sine, cosine]]) + change[:2]


def area(west_m: float, east_m: float, south_m: float, north_m: float) -> np.ndarray:
    """Places 3 cm apart."""
    steps = np.arange(west_m, east_m, 0.03), np.arange(south_m, north_m, 0.03)
    return np.stack(np.meshgrid(*steps), axis=-1).reshape(-1, 2)


def drawn(
    stands_m: np.ndarray, change: np.ndarray, west_m: float = -0.2, east_m: float = 6.2,
    seed: int = 0, inside_m: np.ndarray | None = None,
) -> OccupancyMap:  # fmt: skip
    """A map of what stands from one side of the room to another, in a frame of its own.

    All else there is free; places are off by 3 cm.
    """
    rng = np.random.default_rng(seed)
    stands_m = stands_m[(stands_m[:, 0] > west_m) & (stands_m[:, 0] < east_m)]
    inside_m = area(0.0, 6.0, 0.0, 4.0) if inside_m is None else inside_m
    inside_m = inside_m[(inside_m[:, 0] > west_m) & (inside_m[:, 0] < east_m)]
    stands_m = stands_m + 0.03 * rng.standard_normal(stands_m.shape)
    stands_m, inside_m = turned(stands_m, change), turned(inside_m, change)
    low = np.floor(np.concatenate([stands_m, inside_m]).min(axis=0) / RESOLUTION_M) - 1
    high = np.ceil(np.concatenate([stands_m, inside_m]).max(axis=0) / RESOLUTION_M) + 1
    columns, rows = (high - low).astype(int)
    log_odds = np.full((rows, columns), -5.0, np.float32)
    observed = np.zeros((rows, columns), bool)
    for places_m, value in ((inside_m, -3.0), (stands_m, 2.0)):
        column, row = (np.floor(places_m / RESOLUTION_M) - low).astype(int).T
        log_odds[row, column], observed[row, column] = value, True
    geometry = GridGeometry(RESOLUTION_M, tuple(low * RESOLUTION_M), (rows, columns))
    return OccupancyMap(geometry, log_odds, observed, "robot/odom")


@pytest.mark.parametrize("seed", range(4))
def test_two_parts_of_a_room_are_laid_over_each_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    stands_m = np.concatenate([along(WALLS + NICHE), np.array(POLES)])
    first, second = (np.append(rng.uniform(-5.0, 5.0, 2), rng.uniform(-3.0, 3.0)) for _ in "ab")
    one = drawn(stands_m, first, east_m=4.6, seed=seed)
    other = drawn(stands_m, second, west_m=0.4, seed=seed + 50)
    match = match_maps(one, other)
    assert match is not None
    assert match.is_sure
    found_m = turned(turned(stands_m, second), match.change)
    assert np.abs(found_m - turned(stands_m, first)).max() < 0.15


def test_walls_that_are_the_same_after_half_a_turn_join_nobody() -> None:
    one = drawn(along(WALLS), np.array([1.0, 2.0, 0.4]))
    other = drawn(along(WALLS), np.array([-1.0, 0.5, -1.4]), seed=1)
    match = match_maps(one, other)
    assert match is not None
    assert match.pieces > 50.0
    assert not match.is_sure


def test_poles_say_which_way_round_a_symmetric_room_is() -> None:
    stands_m = np.concatenate([along(WALLS), np.array(POLES)])
    one = drawn(stands_m, np.array([1.0, 2.0, 0.4]))
    other = drawn(stands_m, np.array([-1.0, 0.5, -1.4]), seed=1)
    match = match_maps(one, other)
    assert match is not None
    assert match.is_sure
    assert match.change[2] % (2.0 * np.pi) == pytest.approx(1.8, abs=0.03)


def test_a_corridor_says_nothing_of_how_far_along_it_one_is() -> None:
    sides = along([((0.0, 1.0), (6.0, 1.0)), ((0.0, 3.0), (6.0, 3.0))])
    match = match_maps(drawn(sides, np.zeros(3), east_m=4.0), drawn(sides, np.zeros(3), 2.0))
    assert match is not None
    assert not match.is_sure


def test_a_mirror_image_is_another_room() -> None:
    stands_m = np.concatenate([along(WALLS + NICHE), np.array(POLES)])
    mirrored_m = stands_m * [-1.0, 1.0] + [6.0, 0.0]
    match = match_maps(drawn(stands_m, np.zeros(3)), drawn(mirrored_m, np.zeros(3), seed=1))
    assert match is not None
    assert not match.is_sure


@pytest.mark.parametrize("seed", range(4))
def test_rooms_with_other_things_in_them_are_not_joined(seed: int) -> None:
    rng = np.random.default_rng(seed)
    maps = [
        drawn(
            np.concatenate([along(WALLS), rng.uniform([0.5, 0.5], [5.5, 3.5], (8, 2))]),
            np.zeros(3),
            seed=seed,
        )
        for _ in range(2)
    ]
    match = match_maps(*maps)
    assert match is not None
    assert not match.is_sure


def test_the_two_sides_of_a_corner_are_not_one() -> None:
    corner = along([((0.0, 0.0), (4.0, 0.0)), ((0.0, 0.0), (0.0, 3.0))])
    inside = drawn(corner, np.zeros(3), inside_m=area(0.0, 4.0, 0.0, 3.0))
    outside_m = np.concatenate([area(-1.0, 4.0, -1.0, 0.0), area(-1.0, 0.0, 0.0, 3.0)])
    outside = drawn(corner, np.zeros(3), west_m=-1.2, inside_m=outside_m, seed=1)
    match = match_maps(inside, outside)
    assert match is not None
    # What is best lays one wall over another from the same side, not both walls back to back.
    assert np.hypot(*match.change[:2]) > 1.0


@pytest.mark.parametrize(("side", "least", "most"), [(1.0, 70.0, 85.0), (-1.0, 0.0, 8.0)])
def test_the_two_sides_of_a_wall_that_was_heard_from_afar_are_not_one(
    side: float, least: float, most: float
) -> None:
    """Free space that is known of ends 0.7 m before the wall."""
    wall, free_m = along([((0.0, 0.0), (6.0, 0.0))]), area(0.0, 6.0, 0.7, 3.0)
    one = drawn(wall, np.zeros(3), inside_m=free_m)
    other = drawn(wall, np.zeros(3), inside_m=free_m * [1.0, side], seed=1)
    both, _ = in_common(Submap.of(one), Submap.of(other))
    assert least < both < most


@pytest.mark.parametrize(("length_m", "is_sure"), [(0.3, True), (1.8, False)])
def test_rooms_of_which_one_has_too_much_in_the_others_free_space_are_not_joined(
    length_m: float, is_sure: bool
) -> None:
    desks = along([((x_m, 1.0), (x_m, 1.0 + length_m)) for x_m in (2.5, 3.2)])
    one = drawn(along(WALLS + NICHE), np.zeros(3))
    other = drawn(np.concatenate([along(WALLS + NICHE), desks]), np.zeros(3), seed=1)
    match = match_maps(one, other)
    assert match is not None
    assert match.margin > 4.5
    assert match.is_sure == is_sure


def test_an_empty_map_lies_nowhere() -> None:
    empty = drawn(np.zeros((0, 2)), np.zeros(3))
    assert match_maps(empty, drawn(along(WALLS), np.zeros(3))) is None


def test_a_few_poles_are_not_enough() -> None:
    poles = np.array(POLES[:4])
    match = match_maps(drawn(poles, np.zeros(3)), drawn(poles, np.array([1.0, 0.0, 1.0]), seed=1))
    assert match is not None
    assert not match.is_sure


@pytest.mark.parametrize(
    ("pieces", "margin", "against", "is_sure"),
    [
        # Two robots of one flat, whose poses are off after 1000 pings.
        (77.0, 8.8, 0.06, True),
        # The two legs of an angled corridor, and corridors of two buildings.
        (77.0, 4.1, 0.018, False),
        (77.0, 4.4, 0.026, False),
        (77.0, 3.8, 0.0, True),
        # Two rooms that are each the same after half a turn.
        (45.0, 3.7, 0.0, False),
    ],
)
def test_a_match_is_sure_by_its_margin_and_its_lead_less_what_contradicts_it(
    pieces: float, margin: float, against: float, is_sure: bool
) -> None:
    assert Match(np.zeros(3), np.zeros(2), pieces, margin, against).is_sure == is_sure


@pytest.mark.parametrize(
    ("pieces", "first", "then", "is_sure"),
    [
        # Right ones gain by a second look, in one flat; wrong ones lose, of symmetric rooms.
        (60.0, 2.0, 4.1, True),
        (35.0, 3.9, 0.0, False),
        (24.0, 2.3, 1.9, False),
        # Of two rooms that are the same after half a turn: it stays as it is.
        (51.0, 3.67, 3.69, False),
        (44.0, 4.2, 4.1, False),
        (94.0, 6.7, 6.5, True),
        (11.0, 2.0, 4.1, False),
        # Of two such rooms as well: it gains, by few pieces.
        (29.0, 2.0, 3.5, False),
        # Right, and not told from that.
        (44.0, 2.0, 4.1, False),
    ],
)
def test_a_second_look_makes_sure_of_a_match_that_gains_by_it(
    pieces: float, first: float, then: float, is_sure: bool
) -> None:
    one, again = (
        Match(np.zeros(3), np.zeros(2), pieces, 0.0, 0.1, elsewhere) for elsewhere in (first, then)
    )
    assert again.bears_out(one) == is_sure


@pytest.mark.parametrize(
    ("pieces", "margin", "is_sure"),
    [(132.0, 9.9, True), (100.0, 4.6, True), (100.0, 4.4, False), (60.0, 5.0, False)],
)
def test_a_second_look_at_what_no_map_told_must_make_surer(
    pieces: float, margin: float, is_sure: bool
) -> None:
    again = Match(np.zeros(3), np.zeros(2), pieces, 0.0, 0.1, margin)
    assert again.bears_out(None) == is_sure


def bent(places_m: np.ndarray, rad_per_m: float) -> np.ndarray:
    """Places as a robot has them whose heading drifts on its way along x."""
    angle_rad = rad_per_m * places_m[:, 0]
    along_m = np.sin(angle_rad) / rad_per_m, (1.0 - np.cos(angle_rad)) / rad_per_m
    across_m = np.stack([-np.sin(angle_rad), np.cos(angle_rad)], axis=-1)
    return np.asarray(np.stack(along_m, axis=-1) + places_m[:, 1:] * across_m)


#: Three rooms one behind the other, of 12 m in all, with poles in them.
THREE_ROOMS: list[Segment] = [
    ((0.0, 0.0), (12.0, 0.0)), ((12.0, 0.0), (12.0, 4.0)), ((12.0, 4.0), (0.0, 4.0)),
    ((0.0, 4.0), (0.0, 0.0)), ((3.7, 0.0), (3.7, 2.6)), ((8.6, 1.4), (8.6, 4.0)),
]  # fmt: skip
IN_THREE_ROOMS = np.array([*POLES, (6.2, 3.2), (7.3, 1.2), (9.7, 2.9), (10.9, 0.9), (11.2, 2.3)])


def submaps(stands_m: np.ndarray, rad_per_m: float, seed: int) -> tuple[OccupancyMap, list[Submap]]:
    """A map of three rooms that is bent, and a submap for each of them."""
    inside_m, own = area(0.0, 12.0, 0.0, 4.0), []
    for west_m in (-0.2, 3.6, 8.5):
        here = [
            places_m[(places_m[:, 0] > west_m) & (places_m[:, 0] < west_m + 4.9)]
            for places_m in (stands_m, inside_m)
        ]
        there = [bent(places_m, rad_per_m) for places_m in here]
        own.append(Submap.of(drawn(there[0], np.zeros(3), -1.0, 13.0, seed, there[1])))
    whole = drawn(
        bent(stands_m, rad_per_m), np.zeros(3), -1.0, 13.0, seed, bent(inside_m, rad_per_m)
    )
    return whole, own


@pytest.mark.parametrize(("is_mirrored", "is_found"), [(False, True), (True, False)])
def test_submaps_tell_which_way_bent_maps_lie(is_mirrored: bool, is_found: bool) -> None:
    stands_m = np.concatenate([along(THREE_ROOMS), IN_THREE_ROOMS])
    one, ones = submaps(stands_m, -0.015, 0)
    if is_mirrored:
        stands_m = stands_m * [1.0, -1.0] + [0.0, 4.0]
    other, others = submaps(stands_m, 0.015, 1)
    match = match_maps(one, other)
    assert match is not None
    assert not match.is_sure
    found = promising_by_submaps(match, ones, others)
    assert (found is not None) == is_found
    if found is not None:
        # The middle of the second one lies in that of the first one.
        middle_m = np.array([[6.0, 2.0]])
        off_m = turned(bent(middle_m, 0.015), found.change) - bent(middle_m, -0.015)
        assert np.hypot(*off_m[0]) < 0.4


@pytest.mark.parametrize(("is_mirrored", "margins"), [(False, (3.0, 99.0)), (True, (0.0, 2.0))])
def test_a_way_is_found_piece_by_piece_in_a_map(
    is_mirrored: bool, margins: tuple[float, float]
) -> None:
    stands_m = np.concatenate([along(THREE_ROOMS), IN_THREE_ROOMS])
    there, _ = submaps(stands_m, 1e-6, 0)
    if is_mirrored:
        stands_m = stands_m * [1.0, -1.0] + [0.0, 4.0]
    _, way = submaps(stands_m, 0.03, 1)
    found = match_way(Submap.of(there), way)
    assert found is not None
    assert margins[0] < found.margin < margins[1]
    if not is_mirrored:
        for middle_m, change in zip(
            ([1.8, 2.0], [6.0, 2.0], [10.2, 2.0]), found.changes, strict=True
        ):
            off_m = turned(bent(np.array([middle_m]), 0.03), change) - middle_m
            assert np.hypot(*off_m[0]) < 0.4


def test_a_way_that_shows_nothing_lies_nowhere() -> None:
    there, way = submaps(np.concatenate([along(THREE_ROOMS), IN_THREE_ROOMS]), 1e-6, 0)
    nothing = Submap.of(drawn(np.zeros((0, 2)), np.zeros(3)))
    assert match_way(Submap.of(there), [nothing]) is None
    assert match_way(nothing, way) is None
