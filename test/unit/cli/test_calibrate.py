"""``usmap calibrate`` from end to end."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from usmap_ros.io.bag_reader import BagReader

Run = Callable[..., Any]

SCENARIO = """\
seed: 4
duration_s: 12.0
world:
  points:
    - {x_m: 1.2, y_m: 1.4, reflectivity: 0.4}
    - {x_m: 3.0, y_m: 2.6, reflectivity: 0.7}
    - {x_m: 3.1, y_m: 0.4, reflectivity: 1.0}
    - {x_m: 2.2, y_m: 3.6, reflectivity: 0.8}
    - {x_m: -0.5, y_m: 2.0, reflectivity: 0.5}
medium: {sound_speed_m_s: 349.0, floor_reflectivity: 0.5}
stated: {sound_speed_m_s: 343.0, floor_height_m: 0.6, floor_reflectivity: 0.9}
robots:
  - name: robot1
    motion:
      kind: waypoints
      waypoints_m: [[0.5, 0.5], [2.2, 0.6], [3.8, 1.2], [1.8, 2.2], [0.6, 2.4]]
      speed_m_s: 0.8
      spin_rad_s: 0.8
    transducers:
      - mount: {z_m: 0.4}
        receiver: {noise_std: 0.005}
"""


@pytest.fixture(scope="module")
def folder(folder_of: Callable[..., Path]) -> Path:
    """Give a folder with a recording whose messages are wrong."""
    return folder_of(SCENARIO, ["simulate", "scenario.yaml", "-o", "bag"])


def test_what_it_prints_is_a_parameter_file(usmap: Run, folder: Path) -> None:
    done = usmap("calibrate", "bag", cwd=folder)

    assert done.returncode == 0, done.stderr
    correction = yaml.safe_load(done.stdout)["reconstruction"]["correction"]
    assert correction["sound_speed_m_s"] == pytest.approx(349.0, abs=0.5)
    assert correction["floor_height_m"] == pytest.approx(0.4, abs=0.01)
    assert correction["range_offset_m"] == pytest.approx(0.0, abs=0.005)
    assert "gain" not in correction
    assert "# sound speed: 34" in done.stdout
    assert " ± " in done.stdout


def test_map_obeys_the_file(usmap: Run, folder: Path) -> None:
    (folder / "own.yaml").write_text("mapping: {resolution_m: 0.1}\n")
    target = "--target=3.0,2.6,0.7"
    done = usmap("calibrate", "bag", target, "-p", "own.yaml", "-o", "found.yaml", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "sound speed" in done.stdout
    found = yaml.safe_load((folder / "found.yaml").read_text())
    assert found["mapping"] == {"resolution_m": 0.1}
    assert found["reconstruction"]["correction"]["gain"] == pytest.approx(1.0, rel=0.12)

    summaries = {}
    for name, arguments in {"stated": [], "calibrated": ["-p", "found.yaml"]}.items():
        done = usmap("map", "bag", "-o", name, "--json", "-j", "1", *arguments, cwd=folder)
        assert done.returncode == 0, done.stderr
        summaries[name] = json.loads(done.stdout)
    # With the wrong floor, echoes over it are taken for objects.
    assert summaries["calibrated"]["echoes"] < 0.8 * summaries["stated"]["echoes"]


def test_traces_can_be_set_right_instead(usmap: Run, folder: Path) -> None:
    done = usmap("calibrate", "bag", "-o", "mended", cwd=folder)
    assert done.returncode == 0, done.stderr

    with BagReader([folder / "mended"]) as bag:
        channels = {trace.channel for _, trace in bag.traces()}
    assert len(channels) == 1
    assert channels.pop().sound_speed_m_s == pytest.approx(349.0, abs=0.5)

    done = usmap("calibrate", "mended", "--json", cwd=folder)
    figures = json.loads(done.stdout)
    assert figures["sound_speed_m_s"]["value"] == pytest.approx(349.0, abs=0.5)
    assert figures["range_offset_m"]["value"] == pytest.approx(0.0, abs=0.005)


def test_recording_that_tells_nothing_is_refused(usmap: Run, workspace: Path) -> None:
    done = usmap("calibrate", "bag", "-o", "found.yaml", cwd=workspace)

    assert done.returncode == 1
    assert done.stderr.startswith("usmap: error: bag: tells nothing well enough: gain: ")
    assert "floor height: no echo over a floor was heard" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (workspace / "found.yaml").exists()


def test_a_pulse_alone_is_worth_a_file(usmap: Run, workspace: Path) -> None:
    """A bought transducer, which drives straight on: nothing but its pulse can be told."""
    resonances = "[{frequency_hz: 40000.0, quality: 15.0}]"
    pulse = f"{{shape: tone_burst, carrier_hz: 40000.0, resonances: {resonances}}}"
    scenario = (workspace / "scenario.yaml").read_text()
    scenario = scenario.replace("duration_s: 1.0", "duration_s: 2.0").replace("0.01}", "0.001}")
    (workspace / "bought.yaml").write_text(
        scenario.replace("receiver:", f"pulse: {pulse}\n        receiver:")
    )
    assert usmap("simulate", "bought.yaml", "-o", "bought", cwd=workspace).returncode == 0

    for target in ([], ["--target=40,40"]):
        done = usmap("calibrate", "bought", "-o", "found.yaml", *target, cwd=workspace)
        assert done.returncode == 0, done.stderr
        assert ("no object was heard at x 40 m" in done.stderr) is bool(target)
        found = yaml.safe_load((workspace / "found.yaml").read_text())["reconstruction"]
        assert found["pulse"]["kind"] == "measured"

    if not found["correction"]:
        done = usmap("calibrate", "bought", "-o", "same", cwd=workspace)
        assert done.returncode == 1
        assert "only the pulse is told" in done.stderr


@pytest.mark.parametrize("target", ["1", "1,2,3,4,5", "a,b", "1,2,0", "1,2,1,-1", "nan,1"])
def test_target_that_is_none_is_wrong_usage(usmap: Run, folder: Path, target: str) -> None:
    done = usmap("calibrate", "bag", f"--target={target}", cwd=folder)
    assert done.returncode == 2
    assert "X,Y[,REFLECTIVITY[,RADIUS]]" in done.stderr


def test_topic_without_traces_is_named(usmap: Run, folder: Path) -> None:
    done = usmap("calibrate", "bag", "--topic", "/robot9/echo", cwd=folder)
    assert done.stderr == "usmap: error: bag: has no usable echo traces on /robot9/echo\n"
    assert done.returncode == 1
