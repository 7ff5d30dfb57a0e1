"""Whatever is wrong with the input: one line that names it, status 1, nothing half-written."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.map_files import load_map

Run = Callable[..., Any]


def assert_refused(done: Any, message: str) -> None:
    assert done.stderr == f"usmap: error: {message}\n"
    assert done.stdout == ""
    assert done.returncode == 1


def test_a_missing_bag(usmap: Run, tmp_path: Path) -> None:
    done = usmap("map", "none.mcap", "-o", "map", cwd=tmp_path)
    assert_refused(done, "none.mcap: does not exist")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("content", "cause"), [("", "is empty"), ("Dear diary,\n", "is not an MCAP file")]
)
def test_a_file_that_is_no_recording(usmap: Run, tmp_path: Path, content: str, cause: str) -> None:
    (tmp_path / "text.mcap").write_text(content)
    done = usmap("map", "text.mcap", "-o", "m", cwd=tmp_path)
    assert_refused(done, f"text.mcap: {cause}")
    assert not (tmp_path / "m").exists()


def test_a_bag_without_traces(usmap: Run, tmp_path: Path) -> None:
    with new_bag(tmp_path / "bag"):
        pass
    done = usmap("map", "bag", "-o", "m", cwd=tmp_path)
    assert_refused(done, "bag: holds no usmap_msgs/msg/EchoTrace messages")


def test_a_truncated_bag_is_kept_up_to_the_cut(usmap: Run, workspace: Path) -> None:
    content = (workspace / "bag" / "bag.mcap").read_bytes()
    (workspace / "cut.mcap").write_bytes(content[: len(content) * 3 // 4])
    done = usmap("map", "cut.mcap", "-o", "cut", cwd=workspace)
    assert done.returncode == 0
    assert done.stderr.startswith(
        "usmap: warning: cut.mcap: is cut off; kept 7 messages over 0.6 s"
    )
    assert done.stderr.count("\n") == 1
    assert (workspace / "cut" / "map.yaml").exists()


def test_robots_that_are_too_far_apart(usmap: Run, workspace: Path) -> None:
    scenario = (workspace / "scenario.yaml").read_text()
    robots = scenario[scenario.index("  - name") :]
    far = robots.replace("robot1", "robot2").replace(
        "[[0.0, -1.0], [0.0, 1.0]]", "[[3000.0, 3000.0], [3000.0, 3001.0]]"
    )
    (workspace / "apart.yaml").write_text(scenario + far)
    assert usmap("simulate", "apart.yaml", "-o", "apart", cwd=workspace).returncode == 0
    done = usmap("map", "apart", "-o", "far", cwd=workspace)
    assert done.returncode == 0
    (warning,) = done.stderr.splitlines()
    assert warning.startswith("usmap: warning: /robot2/echo: 10 pings are set apart, pose.position")
    assert "is 4236 m away from all pings that are mapped" in warning
    assert done.stdout.endswith("; set apart: 10 of /robot2/echo far off\n")
    summary = json.loads((workspace / "far" / "summary.json").read_text())
    assert summary["set_apart"] == {"/robot2/echo": {"far off": 10}}


def test_one_ping_in_another_frame_does_not_cost_the_others(usmap: Run, workspace: Path) -> None:
    with BagReader([workspace / "bag"]) as bag, new_bag(workspace / "odd") as writer:
        for number, (topic, trace) in enumerate(bag.traces()):
            writer.write_trace(topic, trace if number else replace(trace, frame_id="x"))
    done = usmap("map", "odd", "-o", "odd_map", cwd=workspace)
    assert done.returncode == 0
    assert "odd_map/map.yaml: 9 pings" in done.stdout
    assert done.stdout.endswith("; set apart: 1 of /robot1/echo in another frame\n")
    assert "is 'x', the map's is 'map'" in done.stderr
    stated = usmap("map", "odd", "-o", "odd_map", "--frame", "x", "--json", cwd=workspace)
    summary = json.loads(stated.stdout)
    assert (summary["pings"], summary["frame_id"]) == (1, "x")
    assert summary["set_apart"] == {"/robot1/echo": {"in another frame": 9}}


def test_unusable_recordings_among_many_are_named_and_the_others_mapped(
    usmap: Run, workspace: Path
) -> None:
    for name in ("good", "empty"):
        shutil.copytree(workspace / "bag", workspace / "bags" / name)
    (mcap,) = (workspace / "bags" / "empty").glob("*.mcap")
    mcap.write_bytes(b"")
    done = usmap("map", "bags", "-o", "all", "-j", "1", "--json", cwd=workspace)
    assert done.returncode == 1
    warning, error = done.stderr.splitlines()
    assert warning == "usmap: warning: bags/empty: is empty"
    assert error.startswith("usmap: error: 1 of 2 recordings could not be used")
    summary = json.loads(done.stdout)
    assert summary["failed"] == {"bags/empty": "is empty"}
    assert (summary["recordings"], summary["areas"]) == (2, 1)
    alone = load_map(workspace / "map")[0]
    np.testing.assert_array_equal(load_map(workspace / "all")[0].log_odds, alone.log_odds)


def test_a_folder_without_recordings(usmap: Run, tmp_path: Path) -> None:
    (tmp_path / "bags" / "notes").mkdir(parents=True)
    done = usmap("map", "bags", "-o", "map", cwd=tmp_path)
    assert done.returncode == 1
    assert "bags: is not a recording" in done.stderr


def test_a_bag_cut_before_its_first_trace(usmap: Run, workspace: Path) -> None:
    content = (workspace / "bag" / "bag.mcap").read_bytes()
    (workspace / "cut.mcap").write_bytes(content[:100])
    done = usmap("map", "cut.mcap", "-o", "cut", cwd=workspace)
    assert_refused(done, "cut.mcap: is cut off before its first echo trace")


def rewrite(source: Path, target: Path, bad: int, **changes: object) -> None:
    """Copy a recording, its first `bad` traces spoilt."""
    with BagReader([source]) as bag, new_bag(target) as writer:
        for number, (topic, trace) in enumerate(bag.traces()):
            writer.write_trace(topic, replace(trace, **changes) if number < bad else trace)


def test_malformed_traces_are_skipped_counted_and_named(usmap: Run, workspace: Path) -> None:
    rewrite(workspace / "bag", workspace / "bad", 2, samples=np.full(8, np.nan, np.float32))
    done = usmap("map", "bad", "-o", "m", "--json", cwd=workspace)
    assert done.returncode == 0
    first, second = done.stderr.splitlines()
    assert first == (
        "usmap: warning: bad/bad.mcap: /robot1/echo at 1700000000.000000 s:"
        " skipped, samples: has 8 of 8 not finite"
    )
    assert second.startswith("usmap: warning: bad/bad.mcap: /robot1/echo at 1700000000.1")
    assert '"samples": 2' in done.stdout
    assert '"pings": 8' in done.stdout


def test_a_bag_of_nothing_but_malformed_traces(usmap: Run, workspace: Path) -> None:
    rewrite(workspace / "bag", workspace / "bad", 10, sample_rate_hz=0.0)
    done = usmap("map", "bad", "-o", "m", cwd=workspace)
    assert done.returncode == 1
    *warnings, error = done.stderr.splitlines()
    assert len(warnings) == 4
    assert warnings[-1] == ("usmap: warning: skipped 10 of 10 messages, by field: sample_rate (10)")
    assert error == (
        "usmap: error: bad: none of its 10 pings can be used, by field: sample_rate (10)"
    )
    assert not (workspace / "m").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mapping: {resolutoin_m: 0.1}",
         "mapping.resolutoin_m: unknown key, did you mean 'resolution_m'?"),
        ("mapping: {resolution_m: -1}",
         "mapping.resolution_m: should be greater than or equal to 0.005 (is -1)"),
        ("maping: {}", "maping: unknown key, did you mean 'mapping'?"),
        ("mapping: [", "line 1: expected the node content, but found '<stream end>'"),
    ],
)  # fmt: skip
def test_a_parameter_file(usmap: Run, workspace: Path, text: str, message: str) -> None:
    (workspace / "p.yaml").write_text(text)
    done = usmap("map", "bag", "-o", "m", "--parameters", "p.yaml", cwd=workspace)
    assert_refused(done, f"p.yaml: {message}")
    assert not (workspace / "m").exists()


def test_a_truth_that_cannot_be_written_leaves_no_recording(usmap: Run, workspace: Path) -> None:
    done = usmap(
        "simulate", "scenario.yaml", "-o", "b", "--truth", "none/truth.yaml", cwd=workspace
    )
    assert_refused(done, "none/truth.yaml: cannot be written: No such file or directory")
    assert not (workspace / "b").exists()


@pytest.mark.parametrize("command", ["map", "simulate"])
def test_an_unwritable_folder(usmap: Run, workspace: Path, command: str) -> None:
    (workspace / "file").touch()
    source = {"map": "bag", "simulate": "scenario.yaml"}[command]
    before = sorted(workspace.iterdir())
    done = usmap(command, source, "-o", "file/out", cwd=workspace)
    assert_refused(done, "file/out: cannot be written: Not a directory")
    assert sorted(workspace.iterdir()) == before


def test_a_recording_is_not_overwritten(usmap: Run, workspace: Path) -> None:
    done = usmap("simulate", "scenario.yaml", "-o", "bag", cwd=workspace)
    assert_refused(done, "bag: exists already; --force replaces it")
    assert usmap("simulate", "scenario.yaml", "-o", "bag", "-f", cwd=workspace).returncode == 0


def test_a_map_that_is_no_recording_is_not_overwritten(usmap: Run, workspace: Path) -> None:
    done = usmap("simulate", "scenario.yaml", "-o", "map", "--force", cwd=workspace)
    assert_refused(done, "map: is in the way and no recording, so it is not replaced")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["evaluate", "none", "--truth", "truth.yaml"],
         "none: does not exist; 'usmap map' writes it"),
        (["evaluate", "bag", "--truth", "truth.yaml"],
         "bag/map.npz: does not exist; 'usmap map' writes it"),
        (["evaluate", "map", "--truth", "none.yaml"], "none.yaml: does not exist"),
        (["evaluate", "map", "--truth", "scenario.yaml"], "scenario.yaml: has no 'resolution'"),
        (["map", "bag", "-o", "m", "--resume", "none"],
         "none: does not exist; 'usmap map' writes it"),
        (["simulate", "none.yaml", "-o", "b"], "none.yaml: does not exist"),
        (["plot", "none", "-o", "p.png"], "none: does not exist"),
        (["plot", "bag", "-o", "p.png", "--ping", "10"],
         "bag: has no ping 10: its 10 pings count from 0"),
        (["plot", "map", "-o", "p.docx"],
         "p.docx: has a suffix that is no kind of picture; use one of .png, .pdf, .svg, .jpg"),
        (["plot", "map", "-o", "none/p.png"],
         "none/p.png: cannot be written: No such file or directory"),
        (["info", "map"], "map: is not a recording: it holds no .mcap or .db3 file"),
    ],
)  # fmt: skip
def test_other_unusable_files(
    usmap: Run, recorded: Path, arguments: list[str], message: str
) -> None:
    assert_refused(usmap(*arguments, cwd=recorded), message)


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["map"],
        ["map", "bag"],
        ["map", "bag", "-o", "m", "--resolution", "coarse"],
        ["map", "bag", "-o", "m", "--resolution", "-1"],
        ["map", "bag", "-o", "m", "--method", "guess"],
        ["map", "bag", "-o", "m", "--set", "resolution"],
        ["map", "bag", "-o", "m", "--set", "mapping.resolution=0.1"],
        ["plot", "bag", "-o", "p.png", "--ping", "-1"],
        ["simulate", "scenario.yaml", "-o", "b", "--compression", "rar"],
        ["simulate", "scenario.yaml", "-o", "b", "--truth", "truth.pgm"],
    ],
)
def test_wrong_usage(usmap: Run, recorded: Path, arguments: list[str]) -> None:
    done = usmap(*arguments, cwd=recorded)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
