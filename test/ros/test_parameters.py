"""Parameters come from files, the command line and at run time; bad ones are refused, with why."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rclpy.parameter import Parameter

from usmap_ros.errors import ConfigurationError
from usmap_ros.nodes.cone_reconstructor import ConeReconstructor
from usmap_ros.nodes.map_fusion import MapFusion


def test_defaults_are_those_of_the_models(live: Any) -> None:
    node = live.add(ConeReconstructor)
    assert node.get_parameter("reconstruction.sparsity").value == 32
    assert node.parameters.value.reconstruction.sparsity == 32


def test_descriptors_tell_meaning_unit_and_range(live: Any) -> None:
    node = live.add(MapFusion)
    descriptor = node.describe_parameter("mapping.resolution_m")
    assert "[m]" in descriptor.description
    assert descriptor.floating_point_range[0].from_value == 0.005
    assert descriptor.floating_point_range[0].to_value == 2.0
    assert node.describe_parameter("mapping.method").additional_constraints.startswith("one of ")
    assert node.describe_parameter("autostart").read_only


def test_a_parameter_can_be_set_while_running(live: Any) -> None:
    node = live.add(ConeReconstructor)
    assert live.set_parameter("/cone_reconstructor", "reconstruction.sparsity", 5).successful
    assert node.parameters.value.reconstruction.sparsity == 5


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("reconstruction.sparsity", 0, "range"),
        ("reconstruction.sparsity", "many", "type"),
        ("reconstruction.model_error", 1.0, "less than 1"),
        ("reconstruction.model_error", float("nan"), "range"),
        ("transducers", ["left"], "read-only"),
        ("no_such_parameter", 1, "undeclared"),
    ],
)
def test_a_bad_value_is_refused_with_its_reason_and_the_node_goes_on(
    live: Any, name: str, value: Any, reason: str
) -> None:
    node = live.add(ConeReconstructor)
    before = node.parameters.value
    result = live.set_parameter("/cone_reconstructor", name, value)
    assert not result.successful
    assert reason in result.reason
    assert node.parameters.value == before
    assert live.set_parameter("/cone_reconstructor", "queue_depth", 7).successful


def test_a_bad_pattern_is_refused(live: Any) -> None:
    live.add(MapFusion)
    result = live.set_parameter("/map_fusion", "topic_pattern", "(")
    assert not result.successful
    assert "is no glob; regular expressions are not taken any more" in result.reason


def test_what_the_map_is_made_of_is_fixed_until_the_node_is_cleaned_up(live: Any) -> None:
    node = live.add(MapFusion)
    result = live.set_parameter("/map_fusion", "mapping.resolution_m", 0.1)
    assert not result.successful
    assert "lifecycle" in result.reason
    node.trigger_deactivate()
    node.trigger_cleanup()
    assert live.set_parameter("/map_fusion", "mapping.resolution_m", 0.1).successful
    node.trigger_configure()
    assert node.session.fusion.occupancy_map().geometry.resolution_m == 0.1


def test_whole_numbers_are_taken_for_real_ones_at_the_start(live: Any) -> None:
    node = live.add(MapFusion, mapping__resolution_m=1)
    assert node.get_parameter("mapping.resolution_m").type_ == Parameter.Type.DOUBLE


def test_a_bad_value_at_the_start_is_refused_with_its_reason(live: Any) -> None:
    with pytest.raises(ConfigurationError, match=r"mapping\.prior.*less than 1"):
        live.add(MapFusion, mapping__prior=2.0)


def _start(*arguments: str, node: str = "map_fusion") -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", f"usmap_ros.nodes.{node}", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.usefixtures("domain")
def test_a_process_with_a_bad_value_says_why_in_one_line() -> None:
    run = _start("--ros-args", "-p", "mapping.resolution_m:=-1.0")
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert "mapping.resolution_m" in run.stderr
    assert "greater than or equal to 0.005" in run.stderr


@pytest.mark.slow
@pytest.mark.usefixtures("domain")
@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        (["--params-file", "config/parameters/coarse.yaml"], "Cannot have a value before ros__p"),
        (["--params-file", "nowhere.yaml"], "nowhere.yaml'. Error: Error opening YAML file"),
        (["-p", "a"], "Couldn't parse parameter override rule: '-p a'"),
        (["--nonsense"], "--nonsense"),
        (["-r", "__ns:=/1 2"], "__ns:=/1 2"),
    ],
)
def test_a_process_with_arguments_that_ros_cannot_read_says_so(
    arguments: list[str], cause: str
) -> None:
    # All nodes begin alike; this one takes least to load.
    run = _start("--ros-args", *arguments, node="bag_recorder")
    assert run.returncode == 1
    # ROS logs lines of its own before.
    *_, last = run.stderr.splitlines()
    assert last.startswith("bag_recorder: error: ROS arguments: ")
    assert cause in last
    assert "Traceback" not in run.stderr


@pytest.mark.usefixtures("domain")
@pytest.mark.parametrize("argument", ["--help", "mapping.resolution_m:=0.1"])
def test_an_argument_that_ros_leaves_over_is_refused(argument: str) -> None:
    run = _start(argument, node="bag_recorder")
    assert run.returncode == 1
    assert run.stderr == (
        f"bag_recorder: error: takes no argument '{argument}', but parameters:"
        " --ros-args -p NAME:=VALUE\n"
    )


def test_a_file_and_the_command_line_reach_the_node(
    live: Any, processes: Any, tmp_path: Path
) -> None:
    file = tmp_path / "parameters.yaml"
    file.write_text(
        "map_fusion:\n  ros__parameters:\n    publish_rate_hz: 7.0\n"
        "    mapping: {resolution_m: 0.2, audibility: 0.9}\n    maping: {prior: 0.1}\n"
    )
    command = [sys.executable, "-m", "usmap_ros.nodes.map_fusion", "--ros-args"]
    command += ["--params-file", str(file), "-p", "order_wait_s:=0.125"]
    process = processes.run(command, "fusion")
    names = ["publish_rate_hz", "mapping.resolution_m", "order_wait_s"]
    # By its former name.
    names.append("mapping.detection_probability")
    response = live.call("rcl_interfaces/srv/GetParameters", "/map_fusion/get_parameters",
                         names=names)  # fmt: skip
    assert [value.double_value for value in response.values] == [7.0, 0.2, 0.125, 0.9]
    said = process.log.read_text()
    assert "'maping.prior' is unknown; did you mean 'mapping.prior'" in said
    assert "audibility is called detection_probability now" in said
