"""How well recordings map at the default settings: what the product promises."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from usmap_ros.io.bags import read_bag
from usmap_ros.io.map_files import load_truth
from usmap_ros.runs.trial import Trial, try_scenario, try_traces
from usmap_ros.simulation import Scenario

#: F1 within one cell.
PROMISED_F1 = {"poles": 0.92, "poles_floor": 0.85, "poles_pose_error": 0.80, "sandbox": 0.80}
#: In scenes of seeds that nobody has looked at, which differ in how hard they are.
SIMULATED_F1 = {"poles": 0.90, "floor": 0.80, "pose_error": 0.80}


def show(name: str, trial: Trial) -> None:
    """Print both F1 scores, for ``pytest -rP``."""
    print(f"{name}: F1 {trial.score.f1:.3f}, range-only {trial.range_only_score.f1:.3f}")


def map_recording(folder: Path, name: str) -> Trial:
    return try_traces(read_bag(folder / name), load_truth(folder / f"{name}_truth.yaml"))


def map_scenario(path: Path, seed: int) -> Trial:
    return try_scenario(Scenario.load(path).model_copy(update={"seed": seed}))


@pytest.mark.recordings
@pytest.mark.parametrize("name", PROMISED_F1)
def test_a_recording_maps_as_well_as_promised(shared_folder: Path, name: str) -> None:
    trial = map_recording(shared_folder / "bags", name)
    show(name, trial)
    assert trial.score.f1 >= PROMISED_F1[name], trial.score
    assert trial.score.f1 > trial.range_only_score.f1 + 0.1, trial.score


@pytest.mark.recordings
@pytest.mark.parametrize("name", ["poles_raw", "poles_envelope"])
def test_recordings_of_the_other_encodings_map(shared_folder: Path, name: str) -> None:
    trial = map_recording(shared_folder / "bags", name)
    show(name, trial)
    assert trial.score.precision >= 0.8, trial.score
    assert trial.score.f1 >= 0.7, trial.score
    assert trial.score.f1 > trial.range_only_score.f1, trial.score


@pytest.mark.parametrize("name", SIMULATED_F1)
def test_a_scene_with_another_seed_maps_well(scenario_folder: Path, name: str) -> None:
    trial = map_scenario(scenario_folder / f"{name}.yaml", seed=4711)
    show(name, trial)
    assert trial.score.f1 >= SIMULATED_F1[name], trial.score
    assert trial.score.f1 > trial.range_only_score.f1 + 0.3, trial.score


@pytest.mark.parametrize(("encoding", "rate_hz"), [("raw", 250e3), ("envelope", 25e3)])
def test_scenes_in_other_encodings_map(
    scenario_folder: Path, encoding: str, rate_hz: float
) -> None:
    scenario = Scenario.load(scenario_folder / "poles.yaml")
    receiver = {"encoding": encoding, "sample_rate_hz": rate_hz, "noise_std": 0.01}
    content = scenario.model_dump(mode="json")
    for robot in content["robots"]:
        for transducer in robot["transducers"]:
            transducer["receiver"] = receiver
    trial = try_scenario(Scenario.from_mapping(content | {"duration_s": 4.0}, "poles.yaml"))
    show(encoding, trial)
    assert trial.score.f1 >= 0.7, trial.score
    assert trial.score.f1 > trial.range_only_score.f1, trial.score


def test_mapping_takes_little_memory_and_says_so(scenario_folder: Path, tmp_path: Path) -> None:
    program = [sys.executable, "-m", "usmap_ros"]
    scenario = str(scenario_folder / "poles.yaml")
    subprocess.run([*program, "simulate", scenario, "-o", "bag"], cwd=tmp_path, check=True)
    subprocess.run([*program, "map", "bag", "-o", "map"], cwd=tmp_path, check=True)
    summary = json.loads((tmp_path / "map" / "summary.json").read_text())
    assert set(summary) >= {
        "pings", "echoes", "seconds", "pings_per_second", "cells_observed", "peak_memory_mb",
    }  # fmt: skip
    assert summary["pings"] == 300
    assert summary["echoes"] > 300
    assert summary["cells_observed"] > 4_000
    assert summary["pings_per_second"] == pytest.approx(summary["pings"] / summary["seconds"])
    # Python and its libraries take 180 MB, the machine code of the loops 75 MB, the compiler 100 MB
    # more where none is kept yet; the rest is the map.
    assert 10 < summary["peak_memory_mb"] < 500
