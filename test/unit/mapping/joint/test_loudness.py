"""A map does not depend on the units of what was heard."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.joint.loudness import (
    FAINTEST_DB,
    LEAST_PINGS,
    LOUDEST_DB,
    raised,
    steps_to_scale,
)
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import LIMIT_STEP_DB, EchoCone

DEAF = 255


def at_one_metre(make_cone: Callable[..., EchoCone], level_db: float, pings: int) -> list[EchoCone]:
    """Pings that hear one echo each."""
    echo = 1.0, 10.0 ** (level_db / 20.0)
    cones = [make_cone(echo, stamp_ns=number) for number in range(pings)]
    return [replace(cone, attenuation_db_m=0.0) for cone in cones]


@pytest.mark.parametrize("level_db", [FAINTEST_DB + 0.1, 0.0, LOUDEST_DB - 0.1])
def test_what_places_differ_by_stays(make_cone: Callable[..., EchoCone], level_db: float) -> None:
    cones = at_one_metre(make_cone, level_db, 2 * LEAST_PINGS)
    assert steps_to_scale((cone, "a") for cone in cones) == {}


@pytest.mark.parametrize(("level_db", "fitting_db"), [(-40.0, FAINTEST_DB), (50.0, LOUDEST_DB)])
def test_each_source_has_units_of_its_own(
    make_cone: Callable[..., EchoCone], level_db: float, fitting_db: float
) -> None:
    off = at_one_metre(make_cone, level_db, LEAST_PINGS)
    right = at_one_metre(make_cone, 0.0, LEAST_PINGS)
    pings = [(cone, "off") for cone in off] + [(cone, "right") for cone in right]
    assert steps_to_scale(pings) == {"off": round((fitting_db - level_db) / LIMIT_STEP_DB)}


def test_who_strikes_no_wall_squarely_has_the_units_of_the_others(
    make_cone: Callable[..., EchoCone],
) -> None:
    askew = at_one_metre(make_cone, FAINTEST_DB - 9.0, LEAST_PINGS)
    square = at_one_metre(make_cone, FAINTEST_DB + 2.0, LEAST_PINGS)
    both = [(cone, "askew") for cone in askew] + [(cone, "square") for cone in square]
    assert steps_to_scale(both) == {}
    # Of another kind of sensor nobody else tells the units.
    other = [(replace(cone, transducer=replace(cone.transducer, max_range_m=9.0)), source)
             for cone, source in both[:LEAST_PINGS]]  # fmt: skip
    assert steps_to_scale(other + both[LEAST_PINGS:]) == {"askew": round(9.0 / LIMIT_STEP_DB)}


def test_a_few_pings_say_nothing_of_units(make_cone: Callable[..., EchoCone]) -> None:
    cones = at_one_metre(make_cone, -40.0, LEAST_PINGS - 1)
    assert steps_to_scale((cone, "a") for cone in cones) == {}


@given(steps=st.integers(-60, 60), code=st.integers(61, 190))
def test_echoes_and_limits_are_raised_alike(
    steps: int, code: int, make_cone: Callable[..., EchoCone]
) -> None:
    cone = make_cone((1.0, 0.5), (1.4, 0.2))
    limits = np.array([code, DEAF], np.uint8)
    there = raised(replace(cone, detection_limits=limits), steps)
    assert there.detection_limits.tolist() == [code + steps, DEAF]
    louder = there.limit_amplitudes()[0] / 10.0 ** ((code * LIMIT_STEP_DB - 100.0) / 20.0)
    np.testing.assert_allclose(there.amplitudes, cone.amplitudes * louder, rtol=1e-5)
    back = raised(there, -steps)
    assert back.detection_limits.tolist() == [code, DEAF]
    np.testing.assert_allclose(back.amplitudes, cone.amplitudes, rtol=1e-5)


@pytest.mark.parametrize("louder_db", [-30.0, 30.0])
def test_a_mirror_is_mapped_in_any_units(mirror_pings: list[EchoCone], louder_db: float) -> None:
    """Of smooth rooms whose samples were a fifth of what they should be, walls were called free."""
    maps = []
    for steps in (0, round(louder_db / LIMIT_STEP_DB)):
        fusion = JointFusion(MappingParameters())
        for cone in mirror_pings:
            fusion.fuse(raised(cone, steps), "robot")
        maps.append(fusion.occupancy_map())
    known, other = maps
    assert known.geometry == other.geometry
    assert known.predicted().any()
    np.testing.assert_array_equal(known.predicted(), other.predicted())
    differ = (known.observed != other.observed).mean()
    assert differ < 0.05
