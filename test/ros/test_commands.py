"""Options of the commands that need ROS reach the nodes that they start."""

import os
import signal
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from usmap_ros.cli.app import app
from usmap_ros.errors import UsmapError
from usmap_ros.live.supervisor import Supervisor

POLES = Path(__file__).parents[2] / "config/scenarios/poles.yaml"


@pytest.fixture
def given(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What a node would have been started with."""
    parameters: dict[str, Any] = {}
    for command in ("replay", "record"):
        monkeypatch.setattr(
            f"usmap_ros.cli.{command}.run_live_node",
            lambda create, group, options: parameters.update(options),
        )
    return parameters


def test_those_of_a_replay(given: dict[str, Any]) -> None:
    arguments = ["replay", "bag", "--rate", "2", "--loop", "--start-paused", "--no-clock"]
    done = CliRunner().invoke(app, [*arguments, "--topics", ".*/echo", "--wait", "7"])
    assert done.exit_code == 0, done.output
    assert given == {
        "bag": "bag",
        "rate": 2.0,
        "loop": True,
        "start_paused": True,
        "topic_pattern": ".*/echo",
        "clock": False,
        "wait_s": 7.0,
    }
    CliRunner().invoke(app, ["replay", "bag", "--clock"])
    assert given["clock"] is True
    # What is not given is left to the node.
    assert given["rate"] is given["loop"] is given["wait_s"] is None


def test_those_of_a_recording(given: dict[str, Any]) -> None:
    done = CliRunner().invoke(app, ["record", "-o", "bag", "--topics", ".*/cone"])
    assert done.exit_code == 0, done.output
    assert given == {"bag": "bag", "topic_pattern": ".*/cone"}


def test_those_of_a_fleet(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    began: list[tuple[Supervisor, float | None]] = []
    monkeypatch.setattr(Supervisor, "run", lambda self, duration: began.append((self, duration)))
    monkeypatch.setattr(signal, "signal", lambda number, handler: None)
    monkeypatch.setenv("ROS_DISCOVERY_SERVER", "")
    file = tmp_path / "nodes.yaml"
    file.write_text("/**: {ros__parameters: {}}")
    arguments = ["fleet", str(POLES), "-o", str(tmp_path), "--parameters", str(file)]
    arguments += ["--robot", "robot2", "--discovery-server", "10.0.0.1:11811", "--duration", "5"]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    ((supervisor, duration),) = began
    assert duration == 5.0
    names = [task.name for task in supervisor.tasks]
    assert names == ["robot2 echo_driver", "robot2 cone_reconstructor", "map_fusion"]
    assert all(str(file) in task.command for task in supervisor.tasks)
    assert f'checkpoint_path:="{tmp_path}"' in supervisor.tasks[-1].command
    assert os.environ["ROS_DISCOVERY_SERVER"] == "10.0.0.1:11811"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("/**: [", "line 1: expected the node content, but found '<stream end>'"),
        ("mapping: {resolution_m: 0.1}", "holds no ROS parameters: see config/parameters"),
    ],
)
def test_a_fleet_refuses_a_parameter_file_that_every_node_would_end_over(
    tmp_path: Path, text: str, message: str
) -> None:
    file = tmp_path / "nodes.yaml"
    file.write_text(text)
    done = CliRunner().invoke(app, ["fleet", str(POLES), "--parameters", str(file)])
    assert isinstance(done.exception, UsmapError)
    assert str(done.exception).startswith(f"{file}: {message}")
