"""What others' pings let expect of a robot's."""

import math
from collections.abc import Callable, Sequence
from itertools import product

import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.mapping.joint.leave_one_out import LeaveOneOutMap
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: How far away robots look at what stands at the origin, and how far off their axes: how loud it is
#: tells where it is.
AWAY_M, OFF_AXIS_RAD = 1.5, (-0.6, -0.3, 0.0, 0.3, 0.6)
ONE_SIDE_DEG, MANY_SIDES_DEG = (-20.0, -10.0, 0.0, 10.0, 20.0), (-120.0, -60.0, 0.0, 60.0, 120.0)


def pings_from(
    make_cone: Callable[..., EchoCone], directions_deg: Sequence[float], *, hear: bool = True
) -> list[EchoCone]:
    beam, cones = BeamPattern.linear(), []
    for direction_rad, off_rad in product(map(math.radians, directions_deg), OFF_AXIS_RAD):
        pose = {
            "x_m": AWAY_M * math.cos(direction_rad),
            "y_m": AWAY_M * math.sin(direction_rad),
            "yaw_rad": direction_rad + math.pi + off_rad,
        }
        echoes = [(AWAY_M, float(beam.gain(off_rad)) / AWAY_M**2)] if hear else []
        cones.append(make_cone(*echoes, stamp_ns=len(cones), **pose))
    return cones


@pytest.mark.parametrize(
    ("heard_from_deg", "from_deg", "is_expected"),
    [(ONE_SIDE_DEG, 30.0, True), (ONE_SIDE_DEG, 80.0, False), (MANY_SIDES_DEG, 80.0, True)],
    ids=["the same side", "another side", "any side"],
)
def test_what_was_heard_from_one_side_is_not_expected_from_another(
    make_cone: Callable[..., EchoCone],
    heard_from_deg: tuple[float, ...],
    from_deg: float,
    *,
    is_expected: bool,
) -> None:
    """Healthy robots that looked along smooth walls were said not to hear what is there."""
    others = pings_from(make_cone, heard_from_deg)
    together = LeaveOneOutMap({"one": others, "two": others}, MappingParameters())

    expected = together.expected({"three": pings_from(make_cone, [from_deg], hear=False)})

    loudest = max(ping.power.max() / ping.ping_bins.noise for ping in expected["three"])
    assert (loudest > 10.0) == is_expected
