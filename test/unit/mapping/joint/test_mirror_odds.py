"""What tells mirrors from lines by chance, and which way each sign points."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.joint.surfaces.mirror_odds import MOST_ODDS, mirror_odds
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall

HEARD = np.arange(12)
WALL = MirrorWall(0.0, 2.0, 0.0, 2.0, HEARD, HEARD, 2.0, 1.0, -0.5, 0.2, 0.0)
EXPLAINED = 0.5


def odds_of(wall: MirrorWall, explained: float = EXPLAINED) -> float:
    return float(mirror_odds([wall], explained)[0])


@pytest.mark.parametrize(
    "chance", [{"following": 6.0}, {"before": 4.0}, {"deviation": 0.4}, {"over_point": -9.0}]
)
def test_what_chance_lines_up_is_less_likely_a_mirror(chance: dict[str, float]) -> None:
    assert odds_of(replace(WALL, **chance)) < odds_of(WALL) - 0.2


def test_where_cells_explain_most_echoes_mirrors_are_less_likely() -> None:
    assert odds_of(WALL, 0.9) < odds_of(WALL) - 0.2


def test_no_wall_decides_by_itself_beyond_some_odds() -> None:
    best = replace(WALL, following=0.0, before=0.0, deviation=0.0, over_point=1000.0)
    worst = replace(WALL, following=50.0, before=50.0, deviation=0.45, over_point=-1000.0)
    assert odds_of(best, 0.0) == MOST_ODDS
    assert odds_of(worst, 1.0) == -MOST_ODDS
    assert mirror_odds([], EXPLAINED).shape == (0,)
