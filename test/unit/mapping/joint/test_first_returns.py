"""Sensors that report the first thing only, among walls that scatter and among mirrors."""

import math

import numpy as np
import pytest

from usmap_ros.mapping.joint.estimate import ROUNDS, JointEstimate
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.joint.leave_one_out import kept_pings
from usmap_ros.mapping.joint.surfaces.first_returns import answer_as_mirrors
from usmap_ros.mapping.joint.surfaces.mirror_walls import perpendicular_walls
from usmap_ros.mapping.joint.visibility.field import field_around
from usmap_ros.mapping.joint.witnesses import MutualEvidence
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.range_cones import RangeReading

HALF_ANGLE_RAD, WALL_M, GREATEST_M = math.radians(20.0), 1.5, 4.0
#: A sensor that looks squarely at the wall, and one that looks aslant.
YAWS_RAD = 0.5 * math.pi, math.radians(35.0)


def readings_along_a_wall(is_mirror: bool) -> list[EchoCone]:
    """Drives to the right, 1.5 m below a wall."""
    cones = []
    for number in range(60):
        for sensor, yaw_rad in enumerate(YAWS_RAD):
            off_rad = max(0.0, 0.5 * math.pi - yaw_rad - HALF_ANGLE_RAD)
            is_heard = off_rad == 0.0 or not is_mirror
            reading = RangeReading(
                1_000_000 * (2 * number + sensor), f"sensor{sensor}", 2.0 * HALF_ANGLE_RAD,
                0.02, GREATEST_M, WALL_M / math.cos(off_rad) if is_heard else GREATEST_M,
            )  # fmt: skip
            cones.append(reading.cone(Pose.planar(0.06 * number, 0.0, yaw_rad), "map"))
    return cones


def walls_of(cones: list[EchoCone]) -> tuple[list[float], bool]:
    """How far away walls are, and whether they answer as mirrors."""
    table, rows, _, echoes = kept_pings({"robot": cones}, MappingParameters()).pings()[:4]
    walls = perpendicular_walls(
        table, rows, echoes, np.ones(len(echoes.range_m), bool), np.ones(len(rows), bool)
    )
    return [wall.distance_m for wall in walls], answer_as_mirrors(walls, table, rows, echoes)


@pytest.mark.parametrize("is_mirror", [True, False])
def test_a_wall_that_is_not_heard_aslant_is_a_mirror(is_mirror: bool) -> None:
    distances_m, answers = walls_of(readings_along_a_wall(is_mirror))
    assert min(abs(distance_m - WALL_M) for distance_m in distances_m) < 0.01
    assert answers is is_mirror


def test_where_there_is_no_wall_there_is_no_mirror(views: list[EchoCone]) -> None:
    assert not walls_of(views)[1]


def test_a_mirror_that_is_not_heard_aslant_is_shown_and_not_free() -> None:
    fusion = JointFusion(MappingParameters())
    for cone in readings_along_a_wall(is_mirror=True):
        fusion.fuse(cone, "robot")
    occupancy = fusion.occupancy_map()
    geometry = occupancy.geometry
    x_m, y_m = np.arange(0.1, 3.5, geometry.resolution_m), WALL_M + 0.5 * geometry.resolution_m
    row = math.floor((y_m - geometry.origin_m[1]) / geometry.resolution_m)
    columns = np.floor((x_m - geometry.origin_m[0]) / geometry.resolution_m).astype(int)
    assert (occupancy.trinary()[row, columns] == 100).mean() > 0.9


def test_all_is_free_before_a_mirror_whose_echoes_came_from_ways_side_by_side() -> None:
    fusion = JointFusion(MappingParameters())
    for cone in readings_along_a_wall(is_mirror=True)[::2]:
        fusion.fuse(cone, "robot")
    occupancy = fusion.occupancy_map()
    geometry = occupancy.geometry
    left, right = (int((x_m - geometry.origin_m[0]) / geometry.resolution_m) for x_m in (0.3, 3.2))
    low, high = (int((y_m - geometry.origin_m[1]) / geometry.resolution_m) for y_m in (0.2, 1.3))
    assert (occupancy.trinary()[low:high, left:right] == 0).mean() > 0.9


def test_a_wall_is_one_whatever_its_distance() -> None:
    """Readings do not say how loud: what was made up for that left near and far ones out."""
    cones = []
    for number in range(40):
        place_m = 0.05 * number
        reading = RangeReading(
            1_000_000 * number,
            "sensor",
            2.0 * HALF_ANGLE_RAD,
            0.02,
            GREATEST_M,
            0.4 + 0.08 * number,
        )
        # Along a way that leads away from the wall.
        cones.append(
            reading.cone(Pose.planar(place_m, WALL_M - 0.4 - 0.08 * number, YAWS_RAD[0]), "map")
        )
    table, rows, _, echoes = kept_pings({"robot": cones}, MappingParameters()).pings()[:4]
    every = np.ones(len(echoes.range_m), bool)
    (wall,) = perpendicular_walls(table, rows, echoes, every, np.ones(len(rows), bool))
    assert len(wall.pings) == len(cones)
    assert wall.distance_m == pytest.approx(WALL_M, abs=0.01)


@pytest.mark.parametrize(
    ("share", "farther", "is_mirror"),
    [
        pytest.param(0.3, 1.4, True, id="other things are heard now and then"),
        pytest.param(0.8, 1.4, False, id="most hear the wall"),
        pytest.param(0.0, 1.15, False, id="the beam is narrower than it is said to be"),
    ],
)
def test_rough_walls_are_heard_at_the_edge_of_the_beam(
    share: float, farther: float, is_mirror: bool
) -> None:
    cones = readings_along_a_wall(is_mirror=False)
    for number in range(1, len(cones), 2):
        if number // 2 % 10 >= 10 * share:
            cones[number] = RangeReading(
                cones[number].stamp_ns, "sensor1", 2.0 * HALF_ANGLE_RAD, 0.02, GREATEST_M,
                farther * float(cones[number].ranges_m[0]),
            ).cone(cones[number].pose, "map")  # fmt: skip
    assert walls_of(cones)[1] is is_mirror


@pytest.mark.parametrize("is_mirror", [True, False])
def test_among_mirrors_nobody_is_doubted_for_what_is_heard_aslant(
    is_mirror: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two agree, and deny what a third one says: of two of nine healthy robots nothing was left."""
    cones, names = readings_along_a_wall(is_mirror), ("first", "second", "third")
    kept = KeptPings(MappingParameters())
    for number, cone in enumerate(cones):
        kept.add(cone, names[number // 2 % 3])
    pings = kept.pings()
    field = field_around(pings.table, pings.rows, MappingParameters().resolution_m)
    estimate = JointEstimate(
        pings.table, pings.rows, pings.weights, pings.echoes, field, first_only=pings.first_only
    )
    estimate.estimate_powers(ROUNDS)
    estimate.estimate_walls()
    agreed, contradicted = np.zeros((3, 3)), np.zeros((3, 3))
    agreed[0, 1] = agreed[1, 0] = 900.0
    contradicted[2, :2] = contradicted[:2, 2] = 900.0
    said = MutualEvidence(agreed, contradicted)
    monkeypatch.setattr("usmap_ros.mapping.joint.estimate.mutual_evidence", lambda *_: said)

    credit = estimate.credit(pings.sources)

    assert credit["first"] == credit["second"] == 1.0
    assert credit["third"] == (1.0 if is_mirror else 0.0)
