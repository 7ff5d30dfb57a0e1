"""Who is elsewhere than it says, by what others bear out of it at places that are tried."""

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from usmap_ros.mapping.robot_check import shifts
from usmap_ros.mapping.robot_check.displacement import Displacement
from usmap_ros.mapping.robot_check.shifts import SHIFTS_M, RobotPairs, is_sure, shifted
from usmap_ros.numerics.arrays import FloatArray

#: A place among those that are tried: 0.9 m to the north.
THERE, TINY_M = int(np.argmin(np.hypot(*(SHIFTS_M - (0.0, 0.9)).T))), 1e-6

#: What two robots bear out of each other where they are said to be, and were the first one there.
Said = tuple[float, float]
Pairs = Callable[[Mapping[tuple[str, str], Said], Mapping[tuple[str, str], Said]], RobotPairs]


@pytest.mark.parametrize(
    ("told", "gain", "is_moved"),
    [
        (-10.0, 40.0, True),
        (0.0, 45.0, False),
        (-5.0, 58.0, False),
        (6.9, 69.0, False),
        (0.4, 75.6, True),
        (7.0, 263.0, True),
    ],
    ids=[
        "contradicted",
        "alone",
        "hardly contradicted",
        "healthy, where walls reverberate",
        "1 m off, with one other",
        "borne out far better",
    ],
)
def test_one_who_is_alone_where_it_is_may_be_there(
    told: float, gain: float, is_moved: bool
) -> None:
    """Healthy robots in a corner of a room of parallel walls were said to be elsewhere."""
    assert is_sure(Displacement("moved", (0.0, -0.9), gain, told)) == is_moved


@pytest.fixture
def robot_pairs(monkeypatch: pytest.MonkeyPatch) -> Pairs:
    """Makes pairs of robots one, three and two of whom so much is borne out."""

    def pairs(
        latest: Mapping[tuple[str, str], Said], earlier: Mapping[tuple[str, str], Said]
    ) -> RobotPairs:
        def heard(marks: str, by: str, tried_m: FloatArray, out: FloatArray) -> None:
            told, there = latest.get((marks, by), (0.0, 0.0))
            if by.endswith("earlier"):
                told, there = earlier.get((marks, by.removesuffix(" earlier")), (0.0, 0.0))
            for place_m, borne_out in ((SHIFTS_M[0], told), (SHIFTS_M[THERE], there)):
                out[np.hypot(*(tried_m - place_m).T) < TINY_M] += borne_out

        monkeypatch.setattr(shifts, "borne_out", heard)
        names = ("one", "two", "three")
        robots: Any = {name: SimpleNamespace(landmarks=name, heard=name) for name in names}
        before: Any = {
            name: SimpleNamespace(landmarks=f"{name} earlier", heard=f"{name} earlier")
            for name in names
        }
        return RobotPairs(robots, lambda: before)

    return pairs


@pytest.mark.parametrize(
    ("latest", "is_moved"), [((0.0, 0.0), True), ((30.0, 0.0), False)], ids=["apart", "together"]
)
def test_what_others_heard_earlier_tells_where_their_latest_pings_do_not(
    robot_pairs: Pairs, latest: Said, *, is_moved: bool
) -> None:
    """Robots that went apart know of each other's places all the same."""
    pairs = robot_pairs({("two", "one"): latest}, {("two", "one"): (-10.0, 40.0)})

    assert is_sure(pairs.shift("two")) == is_moved


def test_what_is_known_from_before_speaks_for_either_of_two(robot_pairs: Pairs) -> None:
    """A healthy robot was said to be elsewhere where a misplaced one's echoes counted once more."""
    pairs = robot_pairs({("two", "one"): (-10.0, 40.0)}, {("two", "one"): (-10.0, 40.0)})

    assert pairs.shift("one").gain == pairs.shift("two").gain == 100.0


@pytest.mark.parametrize(
    ("of_the_other", "verdicts"),
    [
        (0.0, {"one": "contradicted", "two": "contradicted"}),
        (20.0, {"two": "misplaced"}),
    ],
)
def test_whom_one_other_alone_contradicts_is_accused_if_a_third_bears_that_one_out(
    robot_pairs: Pairs, of_the_other: float, verdicts: dict[str, str]
) -> None:
    """A healthy robot was said to be elsewhere by a misplaced one, which nobody else heard."""
    pairs = robot_pairs({("two", "one"): (-10.0, 50.0), ("three", "one"): (of_the_other, 0.0)}, {})

    assert {name: own.verdict for name, own in shifted(pairs).items()} == verdicts
