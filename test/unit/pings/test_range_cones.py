"""Sensors that report the first thing only are told from sonars that hear one thing at a time."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.range_cones import RangeReading, report_first_only


def reading(range_m: float, frame_id: str = "robot1/range") -> EchoCone:
    told = RangeReading(0, frame_id, 0.8, 0.1, 3.0, range_m)
    return told.cone(Pose.planar(0.0, 0.0, 0.0), "map")


def sonar_pings(*echoes: int, frame_id: str = "robot1/sonar") -> list[EchoCone]:
    """Pings of a sonar that each hear so many things; silence behind them says something."""
    cones = []
    for count in echoes:
        ranges_m = np.linspace(1.0, 2.0, count, dtype=np.float32)
        columns = dict.fromkeys(
            ("ranges_m", "range_stds_m", "amplitudes", "amplitude_stds"), ranges_m
        )
        quiet = np.zeros_like(reading(3.0).detection_limits)
        cones.append(replace(reading(3.0, frame_id), **columns, detection_limits=quiet))
    return cones


def test_a_range_reading_says_itself_that_nothing_is_heard_behind() -> None:
    assert report_first_only([reading(3.0)]) == set()
    assert report_first_only([reading(1.0), reading(3.0)]) == {"robot1/range"}


@pytest.mark.parametrize(
    ("silent", "one", "several"),
    [(0, 120, 2), (0, 30, 0), (420, 180, 0)],
    ids=["walls all around, and noise", "few pings", "few things in reach"],
)
def test_one_pulse_in_a_trace_is_a_range(silent: int, one: int, several: int) -> None:
    pings = sonar_pings(*[0] * silent, *[1] * one, *[2] * several)
    assert report_first_only(pings) == {"robot1/sonar"}


def test_a_sonar_among_few_poles_hears_one_thing_at_a_time() -> None:
    """In noise of 0.04 it was taken for a range sensor, and others contradicted it."""
    assert report_first_only(sonar_pings(*[0] * 67, *[1] * 32, 2)) == set()


def test_a_sonar_of_a_kind_that_hears_several_things_may_hear_one_at_a_time() -> None:
    alone = sonar_pings(*[0] * 100, *[1] * 100)
    assert report_first_only(alone) == {"robot1/sonar"}
    others = sonar_pings(*[0] * 20, *[1] * 50, *[2] * 30, frame_id="robot2/sonar")
    assert report_first_only([*alone, *others]) == set()
