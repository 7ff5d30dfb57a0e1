"""How well recordings map at the default settings: what the product promises."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.evaluation.scoring import score
from usmap_ros.evaluation.sight import is_lone_poles
from usmap_ros.grids import TruthMap
from usmap_ros.io.bags import read_bag
from usmap_ros.io.map_files import load_truth
from usmap_ros.runs.trial import Trial, try_scenario, try_traces
from usmap_ros.simulation import Scenario

#: Of the scenes' receivers, and how often an echo's amplitude must hold it to count as heard.
NOISE_STD, LOUD_ENOUGH = 0.01, 4.0
#: F1 within one cell.
PROMISED_F1 = {"poles": 0.78, "poles_floor": 0.84, "poles_pose_error": 0.72, "sandbox": 0.82}
#: In scenes of seeds that nobody has looked at, which differ in how hard they are.
SIMULATED_F1 = {"poles": 0.89, "floor": 0.80, "pose_error": 0.82}


def show(name: str, trial: Trial) -> None:
    """Print the scores of both maps, for ``pytest -rP``."""
    scores = {"ours": trial.score, "range-only": trial.range_only_score}
    for method, score_ in scores.items():
        print(f"{name}, {method}: F1 {score_.f1:.3f}, known {score_.known:.3f}")


def among_audible(trial: Trial) -> Trial:
    """Score anew, and ask for those poles only that are loud enough to be heard twice.

    A pole of reflectivity 1 is taken for each, and the linear beam of these scenes.
    """
    rows, columns = np.nonzero(trial.truth.occupied)
    poles_m = trial.truth.geometry.cell_centers_m(rows, columns)
    heard = np.zeros(len(poles_m), dtype=int)
    for place_m, (yaw_rad, half_angle_rad, max_range_m) in zip(
        trial.views.positions_m, trial.views.beams, strict=True
    ):
        ahead = poles_m - place_m
        range_m = np.hypot(*ahead.T)
        turned = np.arctan2(ahead[:, 1], ahead[:, 0]) - yaw_rad
        gain = 1.0 - np.abs((turned + np.pi) % (2.0 * np.pi) - np.pi) / half_angle_rad
        heard += (gain >= LOUD_ENOUGH * NOISE_STD * range_m**2) & (range_m <= max_range_m)
    occupied = trial.truth.occupied.copy()
    occupied[rows[heard < 2], columns[heard < 2]] = False
    audible = TruthMap(trial.truth.geometry, occupied)
    ours, ranges = (
        score(occupancy, trial.truth, trial.views, audible)
        for occupancy in (trial.occupancy, trial.range_only)
    )
    return replace(trial, score=ours, range_only_score=ranges)


def map_recording(folder: Path, name: str) -> Trial:
    trial = try_traces(read_bag(folder / name), load_truth(folder / f"{name}_truth.yaml"))
    return among_audible(trial) if is_lone_poles(trial.truth) else trial


def map_scenario(path: Path, seed: int) -> Trial:
    return among_audible(try_scenario(Scenario.load(path).model_copy(update={"seed": seed})))


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
    scenario = Scenario.from_mapping(content | {"duration_s": 4.0}, "poles.yaml")
    trial = among_audible(try_scenario(scenario))
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
