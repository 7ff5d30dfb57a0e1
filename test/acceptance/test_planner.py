"""What a planner makes of the demo's map: there is no way out of the room."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from usmap_ros.evaluation.alignment import AlignedMaps, align
from usmap_ros.evaluation.drivability import drivability, reachable
from usmap_ros.pings.fields_of_view import PingViews
from usmap_ros.runs.trial import Trial, try_scenario
from usmap_ros.simulation import Scenario

pytestmark = pytest.mark.slow

#: Of the demo's room, with the cells that its walls are in: x and y of opposite corners, m.
ROOM_M = (0.0, 0.0), (8.0, 6.0)


class DemoMap(NamedTuple):
    """The demo's map beside the truth, and what its pings looked at."""

    trial: Trial
    maps: AlignedMaps
    views: PingViews

    def reached_m(self) -> np.ndarray:
        """Centres of all cells that a robot of 15 cm radius can get to, (n, 2)."""
        maps = self.maps
        reached = reachable(maps.free, maps.predicted, maps.geometry, self.views.positions_m)
        return maps.geometry.cell_centers_m(*np.nonzero(reached))


@pytest.fixture(scope="module")
def demo(scenario_folder: Path) -> DemoMap:
    trial = try_scenario(Scenario.load(scenario_folder / "room.yaml"))
    return DemoMap(trial, align(trial.occupancy, trial.truth), trial.views)


def test_no_path_of_a_small_robot_leads_out_of_the_room(demo: DemoMap) -> None:
    reached_m = demo.reached_m()
    low_m, high_m = np.array(ROOM_M)
    outside = np.any((reached_m < low_m) | (reached_m > high_m), axis=1)
    assert np.count_nonzero(outside) == 0
    assert drivability(demo.maps, demo.views).escape_m2 == 0.0


def test_it_gets_around_inside_all_the_same(demo: DemoMap) -> None:
    reached_m = demo.reached_m()
    # On either side of the partition.
    for x_m, y_m in [(1.5, 1.0), (1.0, 4.8), (3.5, 4.8), (6.8, 1.0), (6.0, 5.2)]:
        assert np.hypot(*(reached_m - [x_m, y_m]).T).min() < 0.2, (x_m, y_m)
    area_m2 = len(reached_m) * demo.maps.geometry.resolution_m**2
    # The room has 47 m², of which the walls take 4 m² from its centre, the things in it 2 m².
    assert area_m2 > 20.0


def test_a_planner_finds_its_way_round_the_partition(
    demo: DemoMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    from planner import NoPathError, clearance_m, length_m, plan

    path_m = plan(demo.trial.occupancy, (1.0, 4.8), (6.8, 5.0))
    assert clearance_m(path_m, demo.trial.truth) > 0.15
    # Straight through the partition it would be 5.8 m.
    assert 7.0 < length_m(path_m) < 10.0
    assert np.all((path_m > ROOM_M[0]) & (path_m < ROOM_M[1]))
    standing = demo.trial.occupancy.predicted()
    wall_m = demo.trial.occupancy.geometry.cell_centers_m(*np.argwhere(standing)[0])
    with pytest.raises(NoPathError):
        plan(demo.trial.occupancy, (1.0, 4.8), tuple(wall_m))
