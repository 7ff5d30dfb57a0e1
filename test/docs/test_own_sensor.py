"""What the page on one's own sensor shows works as it stands there."""

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import usmap_ros
from usmap_ros.importing import imported_ranges

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "own_sensor.md").read_text(encoding="utf-8")
EXAMPLE, _ = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
DESCRIPTION, RANGES = re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL)
(TABLE,) = re.findall(r"```\n(time_s.*?)```", PAGE, flags=re.DOTALL)
(COMMANDS,) = re.findall(r"```sh\n(.*?)```", PAGE, flags=re.DOTALL)
#: What the page describes: a burst that resonances round off, late, in a converter's counts.
SENSOR = {
    "pulse": {"shape": "tone_burst", "carrier_hz": 40e3, "duration_s": 0.2e-3,
              "resonances": [{"frequency_hz": 40e3, "quality": 10.0}]},
    "beam": {"kind": "table", "angles_rad": [0.0, 0.17, 0.35, 0.52, 0.7],
             "gains": [1.0, 0.9, 0.6, 0.3, 0.0]},
    "min_range_m": 0.2,
    "max_range_m": 3.0,
    "receiver": {"encoding": "raw", "sample_rate_hz": 200e3, "noise_std": 0.004,
                 "latency_s": 0.0002},
}  # fmt: skip
#: Around the pole whose place and strength the commands of the page name.
LAP = [[2.9, 2.0], [2.5, 2.6], [1.8, 3.1], [1.2, 2.5], [1.1, 1.6], [2.0, 1.2], [3.0, 1.2]]
MOTION = {"kind": "waypoints", "waypoints_m": LAP, "speed_m_s": 0.7, "heading_rad": 1.5708}
SCENARIO = {
    "seed": 5,
    "duration_s": 8.0,
    "world": {
        "area_m": [0.0, 4.0, 0.0, 4.0],
        "cylinders": [{"x_m": 2.0, "y_m": 2.0, "radius_m": 0.02, "reflectivity": 0.5}],
    },
    "robots": [{"name": "robot1", "transducers": [SENSOR], "motion": MOTION}],
}


@pytest.fixture(scope="module")
def workplace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with what a sensor has recorded."""
    folder = tmp_path_factory.mktemp("own_sensor")
    scenario = usmap_ros.Scenario.from_mapping(SCENARIO, "own_sensor.yaml")
    traces = [trace for _, trace in usmap_ros.simulate(scenario)]
    np.savez(
        folder / "recorded.npz",
        counts=np.rint(500.0 * np.array([trace.signal() for trace in traces])).astype(np.int16),
        x=[trace.pose.position_m[0] for trace in traces],
        y=[trace.pose.position_m[1] for trace in traces],
        yaw=[trace.pose.yaw_rad for trace in traces],
        time_s=[trace.stamp_ns / 1e9 for trace in traces],
    )
    return folder


@pytest.mark.slow
def test_arrays_become_a_recording_that_maps(
    workplace: Path, usmap: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(workplace)
    exec(compile(EXAMPLE, "docs/own_sensor.md", "exec"), {})
    Path("my_sensor.yaml").write_text(DESCRIPTION, encoding="utf-8")
    for line in COMMANDS.splitlines():
        arguments = shlex.split(line.split(" #")[0])
        done = usmap(*arguments[1:], cwd=workplace)
        assert done.returncode == 0, done.stderr
    truth = usmap_ros.Scenario.from_mapping(SCENARIO, "own_sensor.yaml").truth_map()
    occupancy, _ = usmap_ros.load_map("my_map")
    score = usmap_ros.score(occupancy, truth)
    assert score.precision == 1.0
    assert score.recall == 1.0


def test_files_and_names_of_the_page_exist() -> None:
    for path in re.findall(r"`(src/[^`]*)`", PAGE):
        assert (ROOT / path).is_file(), path
    for link in re.findall(r"\]\((?!https?:)([^)#]+)\)", PAGE):
        assert (ROOT / "docs" / link).exists(), link
    assert "def trace_to_cdr" in (ROOT / "src/usmap_ros/io/conversions/trace.py").read_text()
    assert (
        "class RosMessageTypes" in (ROOT / "src/usmap_ros/nodes/plumbing/ros_types.py").read_text()
    )


def test_the_table_of_ranges_is_imported(tmp_path):
    (tmp_path / "log.csv").write_text(TABLE, encoding="utf-8")
    (tmp_path / "ranges.yaml").write_text(RANGES, encoding="utf-8")
    cones = [cone for _, cone in imported_ranges(tmp_path / "ranges.yaml")]

    assert [len(cone.ranges_m) for cone in cones] == [1, 1, 0, 1, 1]
    assert {cone.frame_id for cone in cones} == {"robot1/odom"}
