import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from PIL import Image

from usmap_ros.cli.plot import Layer
from usmap_ros.grids import LAYERS
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.map_files import load_map, save_map

Run = Callable[..., Any]


def files(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
def test_a_compressed_bag_gives_the_same_map(usmap: Run, workspace: Path, compression: str) -> None:
    usmap("simulate", "scenario.yaml", "-o", "b", "--compression", compression, cwd=workspace)
    usmap("map", "b", "-o", "m", cwd=workspace)
    for name in ("map.npz", "map.pgm", "map.yaml"):
        assert (workspace / "m" / name).read_bytes() == (workspace / "map" / name).read_bytes()


def test_map_writes_what_the_contract_names(recorded: Path) -> None:
    assert sorted(files(recorded / "map")) == ["map.npz", "map.pgm", "map.yaml", "summary.json"]
    summary = json.loads((recorded / "map" / "summary.json").read_text())
    assert summary["pings"] == 10
    assert summary["echoes"] >= 10
    assert summary["pings_per_second"] == pytest.approx(10 / summary["seconds"])
    assert summary["cells_observed"] > 100
    # Of this process, with all that ran in it before; test_compilation.py asks a new one.
    assert summary["peak_memory_mb"] > 10
    assert summary["skipped"] == {}


def test_map_finds_the_poles(usmap: Run, recorded: Path) -> None:
    done = usmap("evaluate", "map", "--truth", "truth.yaml", "--json", cwd=recorded)
    score = json.loads(done.stdout)
    assert score["precision"] == 1.0
    assert score["predicted_cells"] >= 1
    # In the open nothing hides anything; what a robot stands on is behind its own beam.
    assert score["lost"] == 0.0
    assert score["leak"] < 0.25


def test_a_map_is_scored_against_a_truth_of_other_cells(usmap: Run, workspace: Path) -> None:
    usmap("map", "bag", "-o", "coarse", "--resolution", "0.1", cwd=workspace)
    done = usmap("evaluate", "coarse", "--truth", "truth.yaml", "--json", cwd=workspace)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["precision"] == 1.0


def test_maps_of_ranges_only_are_made_to_compare_with(usmap: Run, workspace: Path) -> None:
    usmap("map", "bag", "-o", "first", "--method", "range_only", cwd=workspace)
    score = usmap("evaluate", "first", "--truth", "truth.yaml", "--json", cwd=workspace).stdout
    ours = usmap("evaluate", "map", "--truth", "truth.yaml", "--json", cwd=workspace).stdout
    assert json.loads(score)["precision"] < json.loads(ours)["precision"]
    usmap("map", "bag", "-o", "set", "--set", "mapping.method=range_only", cwd=workspace)
    assert files(workspace / "first")["map.npz"] == files(workspace / "set")["map.npz"]


def test_a_score_for_people(usmap: Run, recorded: Path) -> None:
    lines = usmap("evaluate", "map", "--truth", "truth.yaml", cwd=recorded).stdout.splitlines()
    assert lines[0] == "map against truth.yaml"
    assert [line.split()[0] for line in lines[1:3]] == ["F1", "known"]
    assert [line.split()[0] for line in lines[-3:]] == ["leak", "lost", "escape"]


def test_two_maps_are_scored_beside_each_other(usmap: Run, workspace: Path) -> None:
    usmap("map", "bag", "-o", "ranges", "--method", "range_only", cwd=workspace)
    evaluate = ("evaluate", "map", "--truth", "truth.yaml")
    both = json.loads(usmap(*evaluate, "--beside", "ranges", "--json", cwd=workspace).stdout)
    ranges = usmap("evaluate", "ranges", "--truth", "truth.yaml", "--json", cwd=workspace)
    assert both.pop("beside") == json.loads(ranges.stdout)
    assert both == json.loads(usmap(*evaluate, "--json", cwd=workspace).stdout)
    told = usmap(*evaluate, "--beside", "ranges", cwd=workspace).stdout
    (known,) = [line.split() for line in told.splitlines() if line.split()[:1] == ["known"]]
    assert known[-2:] == [f"{both['known']:.3f}", f"{json.loads(ranges.stdout)['known']:.3f}"]
    missing = usmap(*evaluate, "--beside", "nowhere", cwd=workspace)
    assert missing.returncode == 1
    assert missing.stderr.startswith("usmap: error: nowhere")


def test_a_map_without_beams_is_told_how_far_pings_reached(usmap: Run, workspace: Path) -> None:
    arrays = dict(np.load(workspace / "map" / "map.npz"))
    arrays["path_beams"][:] = np.nan
    (workspace / "other").mkdir()
    np.savez(workspace / "other" / "map.npz", **arrays)
    evaluate = ("evaluate", "other", "--truth", "truth.yaml", "--json")
    without = json.loads(usmap(*evaluate, cwd=workspace).stdout)
    assert (without["leak"], without["sight_known"]) == (None, False)
    told = usmap(*evaluate[:-1], cwd=workspace).stdout.splitlines()[-1].split()
    assert told[:4] == ["in", "sight", "not", "known:"]
    near = json.loads(usmap(*evaluate, "--max-range", "0.5", cwd=workspace).stdout)
    assert near["leak"] is not None
    assert near["sight_known"]
    # The farther they reached, the more could be known.
    far = json.loads(usmap(*evaluate, "--max-range", "10", cwd=workspace).stdout)
    assert far["open_cells"] > near["open_cells"]


def test_resume_goes_on_where_the_map_was_left(usmap: Run, workspace: Path) -> None:
    done = usmap("map", "bag", "-o", "more", "--resume", "map", "--json", cwd=workspace)
    assert json.loads(done.stdout)["pings"] == 10
    with (
        np.load(workspace / "map" / "map.npz") as once,
        np.load(workspace / "more" / "map.npz") as twice,
    ):
        assert len(twice["path_positions"]) == 2 * len(once["path_positions"])
        assert np.count_nonzero(twice["observed"]) >= np.count_nonzero(once["observed"])


def test_maps_of_several_fusions_are_joined(usmap: Run, workspace: Path) -> None:
    done = usmap("merge", "map", "map", "-o", "whole", cwd=workspace)
    assert done.returncode == 0, done.stderr
    one, paths = load_map(workspace / "map")
    whole, whole_paths = load_map(workspace / "whole")
    np.testing.assert_array_equal(whole.log_odds, one.log_odds)
    assert whole_paths == paths
    shutil.copytree(workspace / "map", workspace / "twin")
    assert usmap("merge", "map", "twin", "-o", "whole", cwd=workspace).returncode == 0
    doubled = load_map(workspace / "whole")[0]
    free = one.observed & ~one.predicted()
    assert free.any()
    assert np.all(doubled.log_odds[free] < one.log_odds[free])


def test_the_resolution_can_be_chosen(usmap: Run, workspace: Path) -> None:
    for number, choice in enumerate(
        (["--resolution", "0.1"], ["--set", "mapping.resolution_m=0.1"])
    ):
        usmap("map", "bag", "-o", f"m{number}", *choice, cwd=workspace)
        with np.load(workspace / f"m{number}" / "map.npz") as arrays:
            assert float(arrays["resolution"]) == 0.1


def test_info(usmap: Run, recorded: Path) -> None:
    done = usmap("info", "bag", "--json", cwd=recorded)
    description = json.loads(done.stdout)
    (topic,) = description["topics"]
    assert description["pings"] == topic["pings"] == 10
    assert description["seconds"] == pytest.approx(0.9)
    assert topic["encoding"] == "IQ"
    assert topic["rate_hz"] == pytest.approx(10.0)
    shown = usmap("info", "bag", cwd=recorded).stdout
    assert "/robot1/echo" in shown
    assert "25 kS/s" in shown
    assert "saturated" not in shown


def test_info_fits_a_terminal_of_80_columns(usmap: Run, workspace: Path) -> None:
    with BagReader([workspace / "bag"]) as bag, new_bag(workspace / "two") as writer:
        for _, trace in bag.traces():
            writer.write_trace("/insect_07/front_left/echo", trace)
            slower = replace(
                trace.transducer, pulse=replace(trace.transducer.pulse, duration_s=1e-3)
            )
            writer.write_trace("/insect_08/echo", replace(trace, transducer=slower))
    shown = usmap("info", "two", cwd=workspace).stdout
    table = shown[shown.index("topic") :]
    assert max(map(len, table.splitlines())) <= 80
    assert "kHz (/insect_07/front_left/echo); hann burst, 1 ms, " in shown
    assert "/insect_07/front_left/echo " in table


def test_pings_that_are_left_out_are_counted_alike_everywhere(usmap: Run, workspace: Path) -> None:
    shutil.copytree(workspace / "bag", workspace / "copy")
    done = usmap("map", "bag", "copy", "-o", "both", "--json", cwd=workspace)
    assert json.loads(done.stdout)["skipped"] == {"header.stamp": 10}
    assert done.stderr.splitlines()[-1] == (
        "usmap: warning: skipped 10 of 20 messages, by field: header.stamp (10)"
    )


def test_a_bag_that_is_named_twice_is_read_once(usmap: Run, workspace: Path) -> None:
    again = f"../{workspace.name}/bag"
    done = usmap("map", "bag", again, "-o", "once", "--json", cwd=workspace)
    assert done.stderr == f"usmap: warning: {again}: is given more than once, and read once\n"
    summary = json.loads(done.stdout)
    assert (summary["pings"], summary["skipped"]) == (10, {})


def test_info_tells_of_saturated_pings(usmap: Run, workspace: Path) -> None:
    scenario = (workspace / "scenario.yaml").read_text()
    converter = "noise_std: 0.01, converter: {bits: 12, full_scale: 0.08}"
    (workspace / "loud.yaml").write_text(scenario.replace("noise_std: 0.01", converter))
    usmap("simulate", "loud.yaml", "-o", "loud", cwd=workspace)
    description = json.loads(usmap("info", "loud", "--json", cwd=workspace).stdout)
    assert description["topics"][0]["saturated_pings"] >= 3
    assert "saturated" in usmap("info", "loud", cwd=workspace).stdout


@pytest.mark.parametrize("layer", get_args(Layer))
def test_layers_of_a_map_are_drawn(usmap: Run, workspace: Path, layer: str) -> None:
    assert layer in LAYERS
    done = usmap("plot", "map", "-o", "layer.png", "--layer", layer, cwd=workspace)
    assert done.returncode == 0, done.stderr
    assert (workspace / "layer.png").stat().st_size > 5000


def test_maps_are_drawn_to_one_extent_where_it_is_given(usmap: Run, workspace: Path) -> None:
    usmap("map", "bag", "-o", "coarse", "--resolution", "0.2", cwd=workspace)
    sizes = []
    for name in ("map", "coarse"):
        done = usmap("plot", name, "-o", f"{name}.png", "--extent", "-1,3,-2,2", cwd=workspace)
        assert done.returncode == 0, done.stderr
        with Image.open(workspace / f"{name}.png") as picture:
            sizes.append(picture.size)
    assert sizes[0] == sizes[1]
    for wrong in ("1,0,0,1", "a", "0,1,0,nan", "0,1,2"):
        done = usmap("plot", "map", "-o", "x.png", "--extent", wrong, cwd=workspace)
        assert done.returncode == 2
        assert "is not of the form X0,X1,Y0,Y1" in " ".join(done.stderr.replace("│", "").split())
    assert usmap("plot", "bag", "-o", "x.png", "--extent", "0,1,0,1", cwd=workspace).returncode == 2


def test_plan_names_poses_and_draws_them(usmap: Run, undecided: Path) -> None:
    done = usmap("plan", "map", "--json", "-n", "2", "-o", "plan.png", cwd=undecided)
    assert done.returncode == 0, done.stderr
    views = json.loads(done.stdout)
    assert 1 <= len(views) <= 2
    assert all(set(view) == {"x_m", "y_m", "yaw_rad", "score"} for view in views)
    assert all(view["score"] > 0.0 for view in views)
    assert (undecided / "plan.png").stat().st_size > 5000
    assert "heading (rad)" in usmap("plan", "map", cwd=undecided).stdout


def test_a_plan_needs_to_know_what_pings(usmap: Run, workspace: Path) -> None:
    occupancy, _ = load_map(workspace / "map")
    save_map(workspace / "bare", occupancy)
    done = usmap("plan", "bare", cwd=workspace)
    assert done.returncode == 1
    assert "bare: has no pings; state --half-angle and --max-range" in done.stderr
    stated = usmap(
        "plan", "bare", "--half-angle", "0.5", "--max-range", "3", "--json", cwd=workspace
    )
    assert stated.returncode == 0, stated.stderr


def test_a_map_without_ambiguity_has_no_plan(usmap: Run, workspace: Path) -> None:
    occupancy, paths = load_map(workspace / "map")
    save_map(workspace / "bare", replace(occupancy, layers={}), paths)
    done = usmap("plan", "bare", cwd=workspace)
    assert done.returncode == 1
    assert "bare: has no layer ambiguity" in done.stderr


@pytest.mark.parametrize("source", ["bag", "map", "map/map.npz"])
@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_plot(usmap: Run, workspace: Path, source: str, suffix: str) -> None:
    name = f"picture.{suffix}"
    done = usmap("plot", source, "-o", name, "--truth", "truth.yaml", cwd=workspace)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{name}\n"
    if suffix == "png":
        with Image.open(workspace / name) as picture:
            assert min(picture.size) > 500


class TestProcess:
    """The program in a process of its own."""

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        program = [sys.executable, "-m", "usmap_ros", *arguments]
        return subprocess.run(program, capture_output=True, text=True, check=False)

    def test_version_and_help_come_at_once(self) -> None:
        self.run("--help")
        before = os.times()
        assert "simulate" in self.run("--help").stdout
        after = os.times()
        # Half a second on an idle machine: processor time counts, because this one may be busy.
        assert after.children_user - before.children_user < 1.5
        assert self.run("--version").stdout == "usmap 0.1.0\n"

    def test_an_error_ends_it_with_one_line(self, tmp_path: Path) -> None:
        done = self.run("map", str(tmp_path / "none"), "-o", str(tmp_path / "map"))
        assert done.returncode == 1
        assert done.stderr == f"usmap: error: {tmp_path / 'none'}: does not exist\n"

    def test_a_reader_that_stops_reading_is_no_error(self, recorded: Path) -> None:
        program = f"{sys.executable} -m usmap_ros"
        done = subprocess.run(
            f"{program} info bag | true", shell=True, capture_output=True, text=True,
            cwd=recorded, check=False,
        )  # fmt: skip
        assert "Traceback" not in done.stderr


def test_samples_in_other_units_are_brought_to_the_right_ones(usmap: Run, workspace: Path) -> None:
    with BagReader([workspace / "bag"]) as bag, new_bag(workspace / "counts") as writer:
        for topic, trace in bag.traces():
            counts = (2000.0 * trace.samples).astype(np.float32)
            writer.write_trace(topic, replace(trace, samples=counts, noise_std=0.0))

    for arguments in (["map", "counts", "-o", "learnt"], ["info", "counts"]):
        done = usmap(*arguments, cwd=workspace)
        assert done.returncode == 0
        said = " ".join((done.stdout + done.stderr).split())
        assert "its samples are some 60 dB larger than echoes are" in said

    gain = "reconstruction.correction.gain=2000"
    done = usmap("map", "counts", "-o", "told", "--set", gain, cwd=workspace)
    assert done.stderr == ""
    learnt, told = (
        {
            tuple(np.add(cell, found.geometry.first_cell[::-1]).tolist())
            for cell in np.argwhere(found.predicted())
        }
        for found in (load_map(workspace / name)[0] for name in ("learnt", "told"))
    )
    assert told
    assert learnt == told


def test_walls_of_a_map_become_part_of_the_sensing_matrix(usmap: Run, tmp_path: Path) -> None:
    (tmp_path / "hall.yaml").write_text(
        "duration_s: 0.2\n"
        "world:\n"
        "  points: [{x_m: 2.025, y_m: 1.025}]\n"
        "  walls: [{corners_m: [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]], closed: true}]\n"
        "  wall_paths: true\n"
        "robots:\n"
        "  - name: robot\n"
        "    motion: {kind: random_walk, start: [1.0, 1.0, 0.0], speed_m_s: 0.0}\n"
    )
    usmap("simulate", "hall.yaml", "-o", "bag", "--truth", "truth.yaml", cwd=tmp_path)
    found = usmap("walls", "truth.yaml", "-o", "walls.yaml", "--reflectivity", "0.2", cwd=tmp_path)
    cells = ["--set", "reconstruction.dictionary=cells", "--set", "reconstruction.cell_size_m=0.25"]
    known = [*cells, "--set", "reconstruction.known_walls=walls.yaml"]
    usmap("map", "bag", "-o", "blind", *cells, cwd=tmp_path)
    usmap("map", "bag", "-o", "told", *known, cwd=tmp_path)

    assert "4 walls" in found.stdout
    assert files(tmp_path / "blind")["map.npz"] != files(tmp_path / "told")["map.npz"]
    (tmp_path / "walls.yaml").unlink()
    missing = usmap("map", "bag", "-o", "m", *known, cwd=tmp_path)
    assert missing.returncode == 1
    assert missing.stderr.strip().endswith("walls.yaml: does not exist")
