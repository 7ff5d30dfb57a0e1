"""How far robots are believed, by who bears them out."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.joint.surfaces.round_column import RoundColumn
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.witnesses import (
    OF_A_HIT,
    MutualEvidence,
    agreed_on,
    credit,
    mostly_there,
    mutual_evidence,
)
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Places between those of the first robot.
OTHER_VIEWS = ((0.1, 0.2, 0.1), (0.2, -0.6, 0.3), (1.4, 1.6, -1.5), (2.7, 0.7, -2.7))


def said(*pairs: tuple[int, int, float, float], robots: int = 3) -> MutualEvidence:
    """Of pairs of robots, or of one by itself: what they agree on, and what not."""
    agreed, contradicted = (np.zeros((robots, robots)) for _ in range(2))
    for one, other, both, against in pairs:
        agreed[one, other] = agreed[other, one] = both
        contradicted[one, other] = contradicted[other, one] = against
    return MutualEvidence(agreed, contradicted)


@pytest.mark.parametrize(
    "mutual_evidence",
    [
        pytest.param(said(), id="of those who look at nothing together nothing is known"),
        pytest.param(said((0, 1, 90, 0), (0, 2, 40, 0), (1, 2, 80, 5)), id="all agree"),
        # Of a room with smooth walls, and of corridors that have walls between them.
        pytest.param(said((0, 1, 41, 81), (0, 2, 58, 0), (1, 2, 0, 40)), id="smooth walls"),
        pytest.param(said((0, 1, 837, 1821), (0, 2, 0, 83), (1, 2, 860, 833)), id="two sides"),
        pytest.param(said((0, 1, 0, 500), robots=2), id="of two nobody can tell who is wrong"),
        pytest.param(said((0, 1, 0, 500)), id="nor can a third who looks elsewhere"),
        pytest.param(
            said(
                (0, 1, 1, 182),
                (0, 2, 3289, 20),
                (1, 2, 2, 105),
                (0, 0, 2164, 0),
                (1, 1, 2096, 32),
                (2, 2, 1791, 14),
            ),
            id="one in the room beside theirs",
        ),
    ],
)
def test_those_of_whom_nobody_can_tell_are_believed(mutual_evidence: MutualEvidence) -> None:
    assert credit(mutual_evidence) == [1.0] * len(mutual_evidence.agreed)


def test_what_halves_bear_out_is_of_all_robots_that_are_asked_about() -> None:
    mutual_evidence = said((0, 0, 30, 10), (1, 1, 0, 20), (0, 1, 9, 0))

    assert mutual_evidence.borne_out_by_themselves(0, 1) == 0.5
    assert mutual_evidence.borne_out_by_themselves(0) == 0.75
    assert said((0, 1, 9, 5)).borne_out_by_themselves(0, 1) == 1.0


def test_one_whom_others_contradict_that_agree_is_not_believed() -> None:
    assert credit(said((0, 1, 500, 50), (0, 2, 5, 300), (1, 2, 0, 400))) == [1.0, 1.0, 0.0]


def test_one_that_is_hardly_known_to_be_wrong_is_believed_in_part() -> None:
    few, more = (credit(said((0, 1, 90, 0), (0, 2, 0, much)))[2] for much in (40, 100))
    assert 0.0 < more < few < 1.0


def test_of_two_the_one_that_contradicts_itself_is_not_believed() -> None:
    pairs = (0, 1, 0, 300), (0, 0, 100, 0), (1, 1, 0, 100)
    assert credit(said(*pairs, robots=2)) == [1.0, 0.0]


def test_two_that_are_wrong_are_both_found() -> None:
    honest = [(one, other, 300.0, 10.0) for one in range(3) for other in range(one)]
    liars = [(one, other, 3.0, 300.0) for one in range(5) for other in (3, 4) if one != other]
    assert credit(said(*honest, *liars, robots=5)) == [1.0, 1.0, 1.0, 0.0, 0.0]


def test_what_is_heard_beside_a_cell_bears_it_out_and_silence_denies_it() -> None:
    field = Field(0, 0, 12, 12, 0.05)
    number = np.array([14, 16, 100], np.int32)
    halves = np.zeros((4, 2, 3), np.float32)
    # One hears the first and the third, the other what is two cells from the first, and nothing
    # where the third is.
    halves[0, :, 0], halves[1, :, 2], halves[2, :, 1] = 9.0, 7.0, 8.0
    halves[3, :, 2] = -5.0
    agreed, contradicted = mutual_evidence(number, halves, field)
    assert agreed[0, 1] == agreed[1, 0] == pytest.approx(8.0)
    assert contradicted[0, 1] == contradicted[1, 0] == pytest.approx(5.0)
    assert np.diag(agreed).tolist() == np.diag(contradicted).tolist() == [0.0, 0.0]


def test_who_hear_the_same_smooth_things_agree() -> None:
    """Cells tell nothing of what mirrors return, so that nobody bore out a robot among them."""
    # Halves of two robots' pings.
    part = np.array([0, 0, 0, 1, 2, 2, 3, 3])
    column = RoundColumn(0.0, 0.0, 0.2, np.array([0, 1, 3, 4, 6]), np.arange(5), is_certain=True)
    alone = replace(column, pings=np.array([4, 5, 7]))

    agreed = agreed_on([column, alone], part, 2)

    assert agreed / OF_A_HIT == pytest.approx(np.array([[1.0, 2.0], [2.0, 1.0 + 1.0]]))


def test_who_stand_on_two_sides_of_a_column_need_not_agree() -> None:
    """Two of three robots hear one side of it, the third the other: that one was not believed."""
    field, nobody = Field(0, 0, 40, 40, 0.05), np.zeros(0, np.int64)
    column = RoundColumn(1.0, 1.0, 0.2, nobody, nobody, is_certain=False)
    # One of each side, and a cell that is far from both.
    number = np.array([20 * 40 + 15, 20 * 40 + 24, 20 * 40 + 34], np.int32)
    halves = np.zeros((4, 2, 3), np.float32)
    halves[0, :, 0] = halves[2, :, 1] = halves[0, :, 2] = 9.0
    halves[1, :, 1] = halves[3, :, 0] = halves[3, :, 2] = -6.0
    for columns, denied in (((), 18.0), ([column], 6.0)):
        said_both = mutual_evidence(number, halves, field, columns)
        assert said_both.contradicted[0, 1] == pytest.approx(denied)
    # What both hear on one side bears them out none the less.
    halves[2, :, 0] = 9.0
    assert mutual_evidence(number, halves, field, [column]).agreed[0, 1] > 0.0


@pytest.fixture(scope="module")
def robots(
    views: list[EchoCone], cone_of_objects: Callable[..., EchoCone]
) -> dict[str, list[EchoCone]]:
    """Give what two robots hear of the same, and what one hears that is not where it says."""
    objects = (1.525, 0.425, 0.6), (1.775, -0.325, 0.4)
    others = [
        cone_of_objects(*objects, x_m=x_m, y_m=y_m, yaw_rad=yaw_rad, stamp_ns=number)
        for number, (x_m, y_m, yaw_rad) in enumerate(OTHER_VIEWS)
    ]
    shift_m = np.array([0.5, -0.4, 0.0])
    elsewhere = [
        replace(cone, pose=replace(cone.pose, position_m=cone.pose.position_m + shift_m))
        for cone in views
    ]
    return {"one": views, "other": others, "misplaced": elsewhere}


def fused(robots: dict[str, list[EchoCone]], **parameters: bool) -> JointFusion:
    """Give the fusion of some robots' pings."""
    fusion = JointFusion(MappingParameters(**parameters))
    for name, cones in robots.items():
        for cone in cones:
            fusion.fuse(cone, name)
    return fusion


def shown(robots: dict[str, list[EchoCone]], **parameters: bool) -> set[tuple[int, int]]:
    """Cells that a map of some robots shows as occupied."""
    occupancy = fused(robots, **parameters).occupancy_map()
    first = np.array(occupancy.geometry.first_cell)[::-1]
    return {tuple(cell) for cell in (np.argwhere(occupancy.predicted()) + first).tolist()}


def test_a_map_shows_nothing_of_what_a_misplaced_robot_heard(
    robots: dict[str, list[EchoCone]],
) -> None:
    honest = {name: cones for name, cones in robots.items() if name != "misplaced"}
    assert shown(robots) == shown(honest)
    assert shown(robots, weigh_robots=False) != shown(honest)


def test_who_is_believed_less_by_a_map_is_told(robots: dict[str, list[EchoCone]]) -> None:
    fusion = fused(robots)
    fusion.occupancy_map()
    assert fusion.doubted == {"misplaced": 0.0}
    honest = fused({name: cones for name, cones in robots.items() if name != "misplaced"})
    honest.occupancy_map()
    assert honest.doubted == {}


def test_healthy_robots_make_the_map_that_they_make_unweighed(
    robots: dict[str, list[EchoCone]],
) -> None:
    honest = {name: cones for name, cones in robots.items() if name != "misplaced"}
    assert shown(honest) == shown(honest, weigh_robots=False)


def test_who_weighs_no_robots_obeys_no_finding_either(views: list[EchoCone]) -> None:
    fusion = JointFusion(MappingParameters(weigh_robots=False))
    for cone in views:
        fusion.fuse(cone, "robot")
    assert not fusion.trust({"robot": 0.0})
    assert fusion.occupancy_map().predicted().any()


def test_who_is_mostly_somewhere_is_there_with_all_pings() -> None:
    """At the edge of a room of mirrors pings of one robot denied the rough wall behind theirs."""
    robot = np.repeat([0, 1, 2], 10)
    is_there = np.zeros(30, bool)
    is_there[:9] = is_there[10:15] = True
    there = mostly_there(robot, is_there).reshape(3, 10).sum(axis=1)
    assert there.tolist() == [10, 5, 0]
