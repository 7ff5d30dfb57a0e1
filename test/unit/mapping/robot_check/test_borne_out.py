"""What a robot that does not hear another one's landmark says of it."""

import math

import numpy as np
import pytest

from usmap_ros.mapping.robot_check.borne_out import NOT_HEARD, borne_out
from usmap_ros.mapping.robot_check.landmark_search import MOST, explain
from usmap_ros.mapping.robot_check.landmarks import COLUMNS
from usmap_ros.mapping.robot_check.sightings import ANGLES, Sightings
from usmap_ros.numerics.arrays import FloatArray

#: How far robots are from the point in the middle, m, and how many pings each sends.
FAR_M, PINGS = 1.2, 12
LOUD_DB, LIMIT_DB = -10.0, -60.0
SOUTH, NORTH = -0.5 * math.pi, 0.5 * math.pi


def around(middle_rad: float, over_rad: float, hears: bool) -> Sightings:
    """Pings at the middle from directions around one of them, with an echo each or none."""
    from_rad = middle_rad + np.linspace(-0.5, 0.5, PINGS) * over_rad
    # Not all from as far: what stands elsewhere would fit as well.
    far_m = FAR_M + 0.2 * np.cos(3.0 * from_rad + 1.0)
    level_db = LOUD_DB - 40.0 * np.log10(far_m)
    echoes = np.arange(PINGS) if hears else np.zeros(0, np.int64)
    return Sightings(
        far_m * np.cos(from_rad), far_m * np.sin(from_rad), from_rad + math.pi,
        np.full(PINGS, 0.5), np.full(PINGS, LIMIT_DB), np.full(PINGS, 4.0),
        np.arange(PINGS + 1) * hears, echoes, far_m[echoes], level_db[echoes],
        np.zeros(ANGLES), 0.3,
    )  # fmt: skip


def landmarks(heard: Sightings) -> FloatArray:
    found = np.zeros((MOST, COLUMNS))
    _, count = explain(heard, np.ones(len(heard.ping), bool), found, -math.inf)
    return found[:count]


@pytest.mark.parametrize(
    ("over_rad", "from_rad", "is_contradicted"),
    [(1.0, SOUTH, True), (1.0, NORTH, False), (1.8 * math.pi, NORTH, True)],
    ids=["from where it was heard", "from behind a wall", "a pole that answers to all sides"],
)
def test_silence_contradicts_what_was_heard_from_the_same_side(
    over_rad: float, from_rad: float, *, is_contradicted: bool
) -> None:
    """A healthy robot beyond a wall that others had heard was said to be elsewhere."""
    marks, said = landmarks(around(SOUTH, over_rad, hears=True)), np.zeros(1)
    assert len(marks)
    borne_out(marks, around(from_rad, 0.4, hears=False), np.zeros((1, 2)), said)
    assert (said[0] < PINGS * NOT_HEARD / 4) == is_contradicted
    assert is_contradicted or said[0] == 0.0
