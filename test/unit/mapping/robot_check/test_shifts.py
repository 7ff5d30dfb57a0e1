"""Who is elsewhere than it says, by what others bear out of it at places that are tried."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from usmap_ros.mapping.robot_check import shifts
from usmap_ros.mapping.robot_check.shifts import SHIFTS_M, RobotPairs, shifted
from usmap_ros.numerics.arrays import FloatArray

#: A place among those that are tried: 0.9 m to the north.
THERE = int(np.argmin(np.hypot(*(SHIFTS_M - (0.0, 0.9)).T)))


@pytest.mark.parametrize(
    ("told", "there", "is_moved"),
    [(-10.0, 30.0, True), (0.0, 45.0, False), (-5.0, 53.0, False), (7.0, 270.0, True)],
    ids=["contradicted", "alone", "hardly contradicted", "borne out far better"],
)
def test_one_who_is_alone_where_it_is_may_be_there(
    told: float, there: float, is_moved: bool
) -> None:
    """Healthy robots in a corner of a room of parallel walls were said to be elsewhere."""
    pairs, said = RobotPairs({}, dict, lambda: None), np.zeros(len(SHIFTS_M))
    said[0], said[THERE] = told, there
    pairs.names, pairs._said = ["one", "other"], {("one", "other"): said}
    assert (pairs.shift("one") is not None) == is_moved


def at(told: float, there: float) -> FloatArray:
    """What is borne out where a robot is said to be, and there."""
    said = np.zeros(len(SHIFTS_M))
    said[0], said[THERE] = told, there
    return said


@pytest.mark.parametrize(
    ("latest", "before", "is_moved"), [(0.0, -10.0, True), (30.0, -10.0, False)]
)
def test_what_others_heard_earlier_tells_where_their_latest_pings_do_not(
    monkeypatch: pytest.MonkeyPatch, latest: float, before: float, *, is_moved: bool
) -> None:
    """Robots that went apart know of each other's places all the same."""

    def heard(_marks: str, by: str, _shifts: FloatArray, out: FloatArray) -> None:
        out += at(before, 40.0) if by == "earlier" else at(latest, 0.0)

    monkeypatch.setattr(shifts, "borne_out", heard)
    robots: Any = {
        name: SimpleNamespace(landmarks=name, heard="latest") for name in ("one", "two", "three")
    }
    earlier: Any = {name: SimpleNamespace(landmarks=name, heard="earlier") for name in robots}

    pairs = RobotPairs(robots, lambda: earlier, lambda: None)

    assert (pairs.shift("one") is not None) == is_moved


@pytest.mark.parametrize(
    ("of_the_other", "verdicts"),
    [
        (0.0, {"one": "contradicted", "two": "contradicted"}),
        (20.0, {"one": "misplaced"}),
    ],
)
def test_whom_one_other_alone_contradicts_is_accused_if_a_third_bears_that_one_out(
    of_the_other: float, verdicts: dict[str, str]
) -> None:
    """A healthy robot was said to be elsewhere by a misplaced one, which nobody else heard."""
    pairs = RobotPairs({}, dict, lambda: None)
    pairs.names = ["one", "three", "two"]
    pairs._said = {
        ("one", "two"): at(-10.0, 50.0),
        ("one", "three"): at(0.0, 0.0),
        ("two", "one"): at(-10.0, 20.0),
        ("two", "three"): at(of_the_other, 0.0),
        ("three", "one"): at(0.0, 0.0),
        ("three", "two"): at(of_the_other, 0.0),
    }

    assert {name: own.verdict for name, own in shifted(pairs).items()} == verdicts
