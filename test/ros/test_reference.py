"""The reference page, and the shipped parameter files, are what the live nodes are."""

import importlib.util
import itertools
import sys
from pathlib import Path
from typing import Any

import pytest
from played_devices import SENSOR

from usmap_ros.io.bags import write_bag
from usmap_ros.live.interfaces import NODES, NodeInterface
from usmap_ros.nodes.bag_recorder import BagRecorder
from usmap_ros.nodes.bag_replay import BagReplay
from usmap_ros.nodes.cone_reconstructor import ConeReconstructor
from usmap_ros.nodes.echo_driver import EchoDriver
from usmap_ros.nodes.map_fusion import MapFusion
from usmap_ros.nodes.serial_driver import SerialDriver
from usmap_ros.parameters.fields import flat_fields, is_among
from usmap_ros.pings.trace import EchoTrace

ROOT = Path(__file__).parents[2]
CLASSES = {
    "bag_recorder": BagRecorder,
    "bag_replay": BagReplay,
    "cone_reconstructor": ConeReconstructor,
    "echo_driver": EchoDriver,
    "map_fusion": MapFusion,
    "serial_driver": SerialDriver,
}
#: Published when there is what they tell of.
LATE = ("map_updates", "~/trajectories")
OF_EVERY_NODE = {"/rosout", "/parameter_events"}
LIFECYCLE = "lifecycle_msgs/"
PARAMETERS = "rcl_interfaces/"
DESCRIPTIONS = "type_description_interfaces/"
OF_RCLPY = {"use_sim_time", "start_type_description_service"}

every_node = pytest.mark.parametrize("interface", NODES, ids=lambda node: node.name)


@pytest.fixture
def start(live: Any, tmp_path: Path, traces: list[tuple[str, EchoTrace]]) -> Any:
    """Give a function that starts a node with what it must be given."""

    def start_node(interface: NodeInterface) -> Any:
        needed: dict[str, Any] = {}
        if interface.name == "echo_driver":
            needed["scenario"] = str(ROOT / "config/scenarios/poles.yaml")
            needed["pose_source"] = "odometry"
        if interface.name == "serial_driver":
            (tmp_path / "sensor.yaml").write_text(SENSOR, encoding="utf-8")
            needed |= {"sensor": str(tmp_path / "sensor.yaml"), "device": "/dev/none"}
        if interface.name == "bag_recorder":
            needed |= {"bag": str(tmp_path / "new"), "topic_pattern": "/none"}
        if interface.name == "bag_replay":
            needed |= {"bag": str(tmp_path / "bag"), "topic_pattern": "/robot1/.*"}
            needed["start_paused"] = True
            write_bag(tmp_path / "bag", itertools.islice(traces, 3))
        if interface.name == "map_fusion":
            needed["cone_topics"] = ["cone"]
        return live.add(CLASSES[interface.name], **needed)

    return start_node


def endpoints(listed: Any) -> set[tuple[str, str]]:
    """Names and types of endpoints as rclpy lists them."""
    return {(name, types[0]) for name, types in listed if name not in OF_EVERY_NODE}


@every_node
def test_live_nodes_have_the_topics_of_the_reference(
    live: Any, start: Any, interface: NodeInterface
) -> None:
    node = start(interface)
    name, peer = node.get_name(), live.peer
    declared = {(node.resolve_topic_name(t.name), t.message_type) for t in interface.publishes
                if t.name not in LATE}  # fmt: skip
    if interface.name == "bag_replay":
        declared.add(("/robot1/echo", "usmap_msgs/msg/EchoTrace"))
    if interface.is_managed:
        declared.add((f"/{name}/transition_event", "lifecycle_msgs/msg/TransitionEvent"))
    live.until(lambda: endpoints(peer.get_publisher_names_and_types_by_node(name, "/"))
               == declared)  # fmt: skip
    # Those of the robots in its recording.
    space = "/robot1/" if interface.name == "bag_replay" else ""
    declared = {
        (node.resolve_topic_name(t.name if t.name[0] == "/" else space + t.name), t.message_type)
        for t in interface.subscribes
        if not t.condition.startswith("input is range")
    }
    live.until(lambda: endpoints(peer.get_subscriber_names_and_types_by_node(name, "/"))
               == declared)  # fmt: skip


@every_node
def test_live_nodes_have_the_services_of_the_reference(
    live: Any, start: Any, interface: NodeInterface
) -> None:
    node = start(interface)
    declared = {
        (service.name.replace("~", f"/{node.get_name()}"), service.service_type)
        for service in interface.services
    }

    def offered() -> set[tuple[str, str]]:
        listed = live.peer.get_service_names_and_types_by_node(node.get_name(), "/")
        ours = endpoints(listed)
        return {
            pair for pair in ours if not pair[1].startswith((LIFECYCLE, PARAMETERS, DESCRIPTIONS))
        }

    live.until(lambda: offered() == declared)


@every_node
def test_live_publishers_have_the_qos_of_the_reference(
    live: Any, start: Any, interface: NodeInterface
) -> None:
    node = start(interface)
    for topic in interface.publishes:
        if topic.name in LATE:
            continue
        name = node.resolve_topic_name(topic.name)
        (info,) = live.until(
            lambda name=name: [
                info
                for info in live.peer.get_publishers_info_by_topic(name)
                if info.node_name == node.get_name()
            ]
        )
        assert (info.qos_profile.reliability.name == "RELIABLE") == topic.qos.is_reliable
        assert (info.qos_profile.durability.name == "TRANSIENT_LOCAL") == topic.qos.is_latched


@every_node
def test_live_nodes_have_the_parameters_of_the_reference(
    start: Any, interface: NodeInterface
) -> None:
    node = start(interface)
    live_names = set(node.list_parameters([], 0).names) - OF_RCLPY
    declared = dict(flat_fields(interface.parameters))
    assert live_names == set(declared)
    for name, info in declared.items():
        descriptor = node.describe_parameter(name)
        assert descriptor.description.startswith(info.description or "")
        assert descriptor.read_only == is_among(name, interface.parameters.fixed)


def test_generated_files_are_up_to_date() -> None:
    specification = importlib.util.spec_from_file_location(
        "make_reference", ROOT / "tools/make_reference.py"
    )
    assert specification is not None
    assert specification.loader is not None
    tool = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(tool)
    stale = [str(path.relative_to(ROOT)) for path in tool.outdated()]
    assert stale == [], "run 'make docs'"


@pytest.mark.slow
@pytest.mark.usefixtures("domain")
@pytest.mark.parametrize("namespace", ["/", "/fleet/robot1"])
def test_the_shipped_parameter_files_are_taken(live: Any, processes: Any, namespace: str) -> None:
    file = ROOT / "config/parameters/cone_reconstructor.yaml"
    command = [sys.executable, "-m", "usmap_ros.nodes.cone_reconstructor", "--ros-args"]
    command += ["-r", f"__ns:={namespace}", "--params-file", str(file)]
    command += ["-p", "queue_depth:=7"]
    process = processes.run(command, "shipped")
    node = f"{namespace.rstrip('/')}/cone_reconstructor"
    response = live.call(
        "rcl_interfaces/srv/GetParameters", f"{node}/get_parameters",
        names=["reconstruction.sparsity", "queue_depth"],
    )  # fmt: skip
    assert [value.integer_value for value in response.values] == [32, 7]
    assert "unknown" not in process.log.read_text()


@every_node
def test_every_shipped_parameter_file_suits_its_node(
    interface: NodeInterface, tmp_path: Path
) -> None:
    import yaml

    from usmap_ros.io.yaml_files import validated

    path = ROOT / f"config/parameters/{interface.name}.yaml"
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    parameters = content[f"/**/{interface.name}"]["ros__parameters"]
    assert validated(path, interface.parameters, parameters) == interface.parameters()


def test_every_node_can_be_run_by_its_entry_point() -> None:
    text = (ROOT / "setup.py").read_text(encoding="utf-8")
    for interface in NODES:
        assert f'"{interface.name}"' in text
        assert callable(importlib.import_module(f"usmap_ros.nodes.{interface.name}").main)
