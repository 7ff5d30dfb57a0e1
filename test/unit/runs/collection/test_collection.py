"""Many recordings, each by itself, give the map that all of them give together."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.errors import UsmapError
from usmap_ros.grids import OccupancyMap
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.map_files import load_map
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.pings.trace import Encoding
from usmap_ros.runs.collection import code_state, cones, find_recordings, map_collection
from usmap_ros.runs.collection.areas import areas_of
from usmap_ros.runs.collection.cones import Cones
from usmap_ros.runs.offline import map_bag
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate

SCENARIO = Path(__file__).parents[4] / "config" / "scenarios" / "poles.yaml"
TOGETHER = SCENARIO.with_name("two_transducers.yaml")
PARAMETERS = PipelineParameters()


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder of folders with six recordings: three robots each in two places 60 m apart."""
    folder = tmp_path_factory.mktemp("fleet")
    pings = list(islice(simulate(Scenario.load(SCENARIO)), 24))
    for place, distance_m in (("here", 0.0), ("there", 60.0)):
        for robot in sorted({topic for topic, _ in pings}):
            with new_bag(folder / place / robot.strip("/").replace("/", "_")) as writer:
                for topic, trace in pings:
                    position_m = trace.pose.position_m + np.array([distance_m, 0.0, 0.0])
                    moved = replace(trace, pose=replace(trace.pose, position_m=position_m))
                    if topic == robot:
                        writer.write_trace(f"/{place}{topic}", moved)
    return folder


@pytest.fixture(scope="module")
def expected(fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> OccupancyMap:
    """Give the map that one process makes of them."""
    folder = tmp_path_factory.mktemp("expected")
    return map_collection(find_recordings([fleet], folder), folder, PARAMETERS).occupancy


def assert_same(one: OccupancyMap, other: OccupancyMap) -> None:
    """Assert that two maps agree: the same cells at 0.65, and log-odds within 1e-4."""
    assert one.geometry == other.geometry
    np.testing.assert_array_equal(one.observed, other.observed)
    np.testing.assert_array_equal(one.predicted(), other.predicted())
    np.testing.assert_allclose(one.log_odds, other.log_odds, rtol=0.0, atol=1e-4)


def test_recordings_are_found_below_a_folder(fleet: Path, tmp_path: Path) -> None:
    found = find_recordings([fleet, fleet / "here"], tmp_path)
    assert [path.relative_to(fleet).parts[0] for path in found] == ["here"] * 3 + ["there"] * 3
    # What was mapped before is no recording to map.
    assert find_recordings([fleet], fleet / "there") == found[:3]
    assert find_recordings([tmp_path / "missing"], tmp_path) == [tmp_path / "missing"]


def test_one_area_gives_the_map_of_its_recordings_together(fleet: Path, tmp_path: Path) -> None:
    recordings = find_recordings([fleet / "here"], tmp_path)
    pipeline = Pipeline(PARAMETERS)
    with BagReader(recordings) as bag:
        together = map_bag(bag, pipeline, RobotPaths())
    done = map_collection(recordings, tmp_path, PARAMETERS)
    assert_same(done.occupancy, pipeline.occupancy_map())
    assert (done.areas, done.run.pings, done.run.echoes) == (1, 24, together.echoes)
    assert done.run.robots.keys() == together.robots.keys()


def test_areas_apart_are_joined(fleet: Path, expected: OccupancyMap, tmp_path: Path) -> None:
    west, east, _, _ = expected.geometry.extent_m
    assert east - west > 60.0
    apart = [
        map_collection(find_recordings([fleet / place], tmp_path), tmp_path, PARAMETERS).occupancy
        for place in ("here", "there")
    ]
    assert expected.observed.sum() == sum(one.observed.sum() for one in apart)
    assert expected.predicted().sum() == sum(one.predicted().sum() for one in apart)


def test_an_area_in_another_frame_than_most_is_left_out_and_named(
    fleet: Path, tmp_path: Path
) -> None:
    shutil.copytree(fleet / "here", tmp_path / "bags")
    (source, *_) = find_recordings([fleet / "there"], tmp_path)
    with BagReader([source]) as bag, new_bag(tmp_path / "bags" / "odd") as writer:
        for topic, trace in bag.traces():
            writer.write_trace(topic, replace(trace, frame_id="odom"))
    done = map_collection(find_recordings([tmp_path / "bags"], tmp_path), tmp_path, PARAMETERS)
    (name,) = done.failed
    assert name.endswith("odd")
    assert "is in the frame 'odom', and most of the others are not" in done.failed[name]
    assert (done.areas, done.run.pings, done.occupancy.frame_id) == (1, 24, "map")


def test_a_second_run_takes_up_the_first(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(fleet / "here", tmp_path / "bags")
    recordings = find_recordings([tmp_path / "bags"], tmp_path)
    first = map_collection(recordings, tmp_path / "map", PARAMETERS)
    made: list[Path] = []
    write = cones._write
    monkeypatch.setattr(cones, "_write", lambda *of: (made.append(of[0]), write(*of))[1])
    assert_same(map_collection(recordings, tmp_path / "map", PARAMETERS).occupancy, first.occupancy)
    assert made == []
    (file,) = recordings[1].glob("*.mcap")
    os.utime(file, ns=(0, 0))
    map_collection(recordings, tmp_path / "map", PARAMETERS)
    assert [path.name.rpartition("-")[0] for path in made] == [recordings[1].name]


def test_cones_of_another_reconstruction_are_not_taken_up(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor would anybody know, after a change of the code, what their map was made by."""
    shutil.copytree(code_state.PACKAGE, tmp_path / "code", ignore=shutil.ignore_patterns("config"))
    recordings = find_recordings([fleet / "here"], tmp_path)
    made: list[Path] = []
    write = cones._write
    monkeypatch.setattr(cones, "_write", lambda *of: (made.append(of[0]), write(*of))[1])

    def made_anew(changed: str) -> int:
        file = tmp_path / "code" / changed
        file.write_text(file.read_text(encoding="utf-8") + "#\n", encoding="utf-8")
        code_state.reconstruction_state.cache_clear()
        made.clear()
        map_collection(recordings, tmp_path / "map", PARAMETERS)
        return len(made)

    monkeypatch.setattr(cones, "PACKAGE", tmp_path / "code")
    assert made_anew("reconstruction/detection.py") == 3
    assert made_anew("mapping/merging.py") == 0
    assert made_anew("reconstruction/sampled/fit.py") == 3


def test_all_that_cones_depend_on_counts() -> None:
    """What the modules that make them import is among the files of which any line counts."""
    counted = {part for maker in code_state.MAKERS for part in [maker.removesuffix(".py")]}
    source = code_state.PACKAGE
    for maker in ("reconstruction/reconstructor.py", "runs/parallel.py"):
        for found in re.findall(r"^from usmap_ros\.([\w.]+)", (source / maker).read_text(), re.M):
            path = found.replace(".", "/")
            assert path in counted or path.split("/")[0] in {*counted, "errors", "processes"}, found


@pytest.fixture(scope="module")
def long(fleet: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give one recording: noise that is not stated, pings that cannot be used, two transducers."""
    bag = tmp_path_factory.mktemp("long") / "bag"
    with BagReader(find_recordings([fleet / "here"], bag)) as reader, new_bag(bag) as writer:
        for number, (topic, trace) in enumerate(reader.traces()):
            noise_std = trace.noise_std if number % 7 == 0 else 0.0
            # In some, the carrier is beyond what real samples at that rate can hold.
            encoding = Encoding.RAW if number % 9 == 0 else trace.encoding
            writer.write_trace(topic, replace(trace, noise_std=noise_std, encoding=encoding))
        for topic, trace in islice(simulate(Scenario.load(TOGETHER)), 8):
            writer.write_trace(topic, trace)
    return bag


def test_a_long_recording_that_is_divided_gives_the_same_map(long: Path, tmp_path: Path) -> None:
    pipeline = Pipeline(PARAMETERS)
    with BagReader([long]) as bag:
        together = map_bag(bag, pipeline, RobotPaths())
    done = map_collection([long], tmp_path, PARAMETERS, stretch=5)
    assert_same(done.occupancy, pipeline.occupancy_map())
    assert (done.run.pings, done.run.echoes) == (together.pings, together.echoes)
    assert done.run.skipped == together.skipped != {}
    assert len(list((tmp_path / "cones").glob("*.json"))) > 6


def test_a_divided_recording_is_taken_up_where_it_was_left(
    long: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = map_collection([long], tmp_path, PARAMETERS, stretch=5)
    notes = sorted((tmp_path / "cones").glob("*.json"), key=lambda path: len(path.name))
    # As if the work had ended before one stretch was done.
    notes[0].unlink()
    notes[-1].unlink()
    made: list[Path] = []
    write = cones._write
    monkeypatch.setattr(cones, "_write", lambda *of: (made.append(of[0]), write(*of))[1])
    again = map_collection([long], tmp_path, PARAMETERS, stretch=5)
    assert_same(again.occupancy, first.occupancy)
    # First come readings of ranges, of which there are none.
    assert [path.name for path in made] == [notes[0].stem, notes[-1].stem]


def test_a_divided_recording_with_nothing_usable_is_named(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    with new_bag(bag) as writer:
        for topic, trace in islice(simulate(Scenario.load(SCENARIO)), 12):
            writer.write_trace(topic, replace(trace, encoding=Encoding.RAW))
    with pytest.raises(UsmapError, match=r"none of its 12 pings can be used.*sample_rate \(12\)"):
        map_collection([bag], tmp_path / "map", PARAMETERS, stretch=5)


def test_boxes_that_touch_by_way_of_a_third_are_one_area() -> None:
    def file(name: str, west: float, east: float) -> Cones:
        return Cones([name], (west, 0.0, east, 5.0), {}, [])

    files = [file("a", 0, 10), file("b", 30, 40), file("far", 90, 95), file("c", 9, 31)]
    names = [[path for member in area for path in member.paths] for area in areas_of(files)]
    assert names == [["a", "b", "c"], ["far"]]
    assert areas_of(files[:3]) == [[files[0]], [files[1]], [files[2]]]


#: In a process of its own: Dask leaves threads behind.
ON_A_CLUSTER = """
import os, signal, sys
from pathlib import Path
from usmap_ros.runs.collection import find_recordings, map_collection
from usmap_ros.io.map_files import save_map
from usmap_ros.processes.cluster import cluster
from usmap_ros.parameters import PipelineParameters

fleet, folder = map(Path, sys.argv[1:])
steps = 0
with cluster("local", 2) as executor:
    before = executor._client.run(os.getpid)

    def step():
        global steps
        steps += 1
        if steps == 1:
            os.kill(next(iter(before.values())), signal.SIGKILL)

    done = map_collection(find_recordings([fleet], folder), folder, PipelineParameters(), executor,
                          step=step, stretch=3)
save_map(folder, done.occupancy)
assert steps == 12, steps
assert not done.failed, done.failed
print(len(before), "workers at the beginning")
"""


@pytest.mark.slow
def test_a_cluster_gives_the_same_map_though_a_worker_is_killed(
    fleet: Path, expected: OccupancyMap, tmp_path: Path
) -> None:
    pytest.importorskip("distributed")
    command = [sys.executable, "-c", ON_A_CLUSTER, str(fleet), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout == "2 workers at the beginning\n", done.stderr
    assert_same(load_map(tmp_path)[0], expected)
