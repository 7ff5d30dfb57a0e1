"""What the tests of the nodes share.

Nodes under test run in the test's own thread, so that an error in a callback fails the test.
"""

import itertools
import os
import signal
import socket
import subprocess
import sys
import time
import warnings
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from usmap_ros.io.conversions import cone_to_cdr, trace_to_cdr
from usmap_ros.live.supervisor import PARENT_VARIABLE
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import EchoSimulator, Scenario, simulate

HAS_ROS = all(find_spec(package) for package in ("rclpy", "usmap_msgs"))
if not HAS_ROS:
    collect_ignore_glob = ["test_*.py"]
else:
    # Its parser imports modules that Python has deprecated; once is enough.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import rosidl_generator_py  # noqa: F401 - for its warnings

    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter import Parameter
    from rclpy.qos import QoSProfile
    from rclpy.serialization import deserialize_message

    from usmap_ros.nodes.plumbing.ros_types import interface_class
    from usmap_ros.nodes.plumbing.run import prepare_environment
    from usmap_ros.nodes.plumbing.status import report_of

    prepare_environment()

ROOT = Path(__file__).parents[2]
SECOND = 1_000_000_000
EPOCH = 1_700_000_000 * SECOND

# Nobody on the network is to take part, and domains above 101 collide with ephemeral ports.
os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(ROOT / "config/dds/one_machine.xml")
# Tests that run at the same time take theirs from sequences that do not meet.
_WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_RUN = zlib.crc32(os.environ.get("PYTEST_XDIST_TESTRUNUID", str(os.getpid())).encode())
_DOMAIN_COUNT = 100 // _WORKERS * _WORKERS
_DOMAINS = itertools.count(_RUN * _WORKERS + _WORKER, _WORKERS)
#: When a service that has not answered is asked again.
ASKED_AGAIN_S = 15.0
#: Participants of a domain whose ports are looked at, and the first one's (RTPS 2.2, 9.6.1.1).
_PARTICIPANTS = 16
_FIRST_PORT, _PORTS_A_DOMAIN, _PORTS_A_PARTICIPANT = 7410, 250, 2


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.ros)


def is_empty(domain: int) -> bool:
    """Whether nobody on this machine listens in a domain."""
    first_port = _FIRST_PORT + _PORTS_A_DOMAIN * domain
    for participant in range(_PARTICIPANTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unicast:
            try:
                unicast.bind(("", first_port + _PORTS_A_PARTICIPANT * participant))
            except OSError:
                return False
    return True


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch) -> int:
    """Give a ROS domain of the test's own.

    There are fewer than tests, and a node is in its domain until it is collected as garbage.
    """
    in_turn = (1 + number % _DOMAIN_COUNT for number in _DOMAINS)
    number = next(filter(is_empty, itertools.islice(in_turn, _DOMAIN_COUNT)))
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    return number


class Live:
    """Nodes in a context of their own, and a peer to talk to them."""

    def __init__(self, domain: int) -> None:
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.peer = rclpy.create_node("peer", context=self.context)
        self.executor.add_node(self.peer)
        self.nodes: list[Any] = []

    def add(self, create: Callable[..., Any], namespace: str = "", **parameters: Any) -> Any:
        """Add a node with parameters; groups are joined by two underscores instead of a dot."""
        node = create(
            context=self.context,
            namespace=namespace,
            parameter_overrides=[
                Parameter(name.replace("__", "."), value=value)
                for name, value in parameters.items()
            ],
        )
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def remove(self, node: Any) -> None:
        """End a node."""
        self.executor.remove_node(node)
        self.nodes.remove(node)
        node.close()
        node.destroy_node()

    def until(
        self, condition: Callable[[], Any], timeout_s: float = 300.0, what: object = None
    ) -> Any:
        """Spin until a condition holds; its value."""
        end_s = time.monotonic() + timeout_s
        while time.monotonic() < end_s:
            self.executor.spin_once(timeout_sec=0.05)
            value = condition()
            if value:
                return value
        raise AssertionError(f"nothing after {timeout_s:g} s: {what or condition}")

    def spin(self, seconds: float) -> None:
        """Spin for some time."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            self.executor.spin_once(timeout_sec=0.02)

    def listen(self, message_type: str, topic: str, qos: Any = 10) -> list[Any]:
        """Subscribe; the list that messages go into."""
        messages: list[Any] = []
        self.peer.create_subscription(interface_class(message_type), topic, messages.append, qos)
        return messages

    def publisher(self, message_type: str, topic: str, qos: Any = 10) -> Any:
        """Publisher that somebody listens to."""
        publisher = self.peer.create_publisher(interface_class(message_type), topic, qos)
        self.until(publisher.get_subscription_count)
        return publisher

    def call(self, service_type: str, name: str, **fields: Any) -> Any:
        """Call a service; its response.

        Who answers drops the response if the middleware has not told it of the caller within a
        tenth of a second: then it is asked again.
        """
        service_class = interface_class(service_type)
        client = self.peer.create_client(service_class, name)
        self.until(client.service_is_ready)
        futures: list[Any] = []
        due_s = time.monotonic()

        def answered() -> Any:
            nonlocal due_s
            if time.monotonic() >= due_s:
                futures.append(client.call_async(service_class.Request(**fields)))
                due_s += ASKED_AGAIN_S
            return next((future for future in futures if future.done()), None)

        response = self.until(answered, what=name).result()
        self.peer.destroy_client(client)
        return response

    def set_parameter(self, node: str, name: str, value: Any) -> Any:
        """Do what 'ros2 param set' does; the result."""
        parameter = Parameter(name, value=value).to_parameter_msg()
        response = self.call(
            "rcl_interfaces/srv/SetParameters", f"{node}/set_parameters", parameters=[parameter]
        )
        return response.results[0]

    def close(self) -> None:
        for node in self.nodes:
            node.close()
            node.destroy_node()
        self.peer.destroy_node()
        self.executor.shutdown()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def live(domain: int) -> Iterator[Live]:
    """Give a place for nodes to run in."""
    place = Live(domain)
    yield place
    place.close()


class Diagnostics:
    """The latest figures of every node."""

    def __init__(self, live: Live) -> None:
        self._messages = live.listen("diagnostic_msgs/msg/DiagnosticArray", "/diagnostics", 100)

    def total(self, node: str, what: str) -> int:
        """A node's latest count of something; 0 if it has not said any."""
        for message in reversed(self._messages):
            for status in message.status:
                if status.name == node:
                    return int(report_of(status).facts.get(what, "0"))
        return 0


@pytest.fixture
def diagnostics(live: Live) -> Diagnostics:
    """Give the figures that nodes report from now on."""
    return Diagnostics(live)


class Processes:
    """Nodes as processes."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._all: list[subprocess.Popen[bytes]] = []

    def start(
        self, node: str, namespace: str = "", prefix: tuple[str, ...] = (), **parameters: Any
    ) -> subprocess.Popen[bytes]:
        """Start a node with parameters."""
        command = [*prefix, sys.executable, "-m", f"usmap_ros.nodes.{node}", "--ros-args"]
        command += ["-r", f"__ns:=/{namespace}"]
        for name, value in parameters.items():
            command += ["-p", f"{name.replace('__', '.')}:={value}"]
        # So that no node outlives tests that are ended by force.
        return self.run(command, f"{node}_{namespace}", {PARENT_VARIABLE: str(os.getpid())})

    def run(
        self, command: list[str], name: str, variables: dict[str, str] | None = None
    ) -> subprocess.Popen[bytes]:
        """Start a program; its output goes into a file of this name."""
        log = self._folder / f"{name}_{len(self._all)}.log"
        with log.open("wb") as file:
            process = subprocess.Popen(
                command,
                stdout=file,
                stderr=subprocess.STDOUT,
                cwd=self._folder,
                env=os.environ | (variables or {}),
                start_new_session=True,
            )
        # Kept with its process; Popen's types know no further attributes.
        process.log = log  # type: ignore[attr-defined]
        self._all.append(process)
        return process

    def end_all(self) -> None:
        """End all processes that still run, and show what they had said."""
        running = [process for process in self._all if process.poll() is None]
        for process in running:
            process.send_signal(signal.SIGINT)
        for process in running:
            try:
                process.wait(15.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        for log in sorted(self._folder.glob("*.log")):
            print(f"---- {log.name}\n{log.read_text(errors='replace')[-3000:]}")


@pytest.fixture
def processes(domain: int, tmp_path: Path) -> Iterator[Processes]:
    """Give a way to start nodes as processes in a domain of their own."""
    folder = tmp_path / "logs"
    folder.mkdir()
    started = Processes(folder)
    yield started
    started.end_all()


@pytest.fixture(scope="session")
def poles() -> Scenario:
    """Give the scenario that most tests use."""
    return Scenario.load(ROOT / "config/scenarios/poles.yaml")


@pytest.fixture(scope="session")
def traces(poles: Scenario) -> list[tuple[str, EchoTrace]]:
    """Give its first second: 30 pings of three robots."""
    return list(itertools.islice(simulate(poles), 30))


@pytest.fixture(scope="session")
def cones(traces: list[tuple[str, EchoTrace]]) -> list[tuple[str, EchoCone]]:
    """Give the topics and cones of those pings."""
    pipeline = Pipeline()
    return [(topic.replace("echo", "cone"), pipeline.reconstruct(t)) for topic, t in traces]


@pytest.fixture
def trace_message(traces: list[tuple[str, EchoTrace]]) -> Any:
    """Give a valid message of a trace."""
    trace_class = interface_class("usmap_msgs/msg/EchoTrace")
    return deserialize_message(trace_to_cdr(traces[0][1]), trace_class)


@pytest.fixture
def cone_message(cones: list[tuple[str, EchoCone]]) -> Any:
    """Give a valid message of a cone."""
    cone_class = interface_class("usmap_msgs/msg/EchoCone")
    return deserialize_message(cone_to_cdr(cones[0][1]), cone_class)


@pytest.fixture
def nav2_qos() -> Any:
    """Give the QoS with which nav2's static layer subscribes to the map."""
    from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

    return QoSProfile(
        depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
    )


@pytest.fixture
def assert_nav2_takes() -> Callable[[Any], None]:
    """Give nav2's own checks of an occupancy grid, and what else a map must be."""

    def check(grid: Any) -> None:
        assert grid.header.frame_id
        turn = grid.info.origin.orientation
        assert np.hypot(np.hypot(turn.x, turn.y), np.hypot(turn.z, turn.w)) == pytest.approx(1.0)
        assert 0 < grid.info.width <= 32767
        assert 0 < grid.info.height <= 32767
        assert len(grid.data) == grid.info.width * grid.info.height
        position, resolution = grid.info.origin.position, grid.info.resolution
        assert resolution > 0.0
        for coordinate in (position.x, position.y):
            cells = coordinate / resolution
            assert cells == pytest.approx(round(cells), abs=1e-3)

    return check


@pytest.fixture
def far_cones() -> Callable[..., list[EchoCone]]:
    """Give a function that makes cones at growing distances from the origin."""

    def make(scenario: Scenario, positions_m: list[tuple[float, float]]) -> list[EchoCone]:
        from usmap_ros.numerics.geometry import Pose

        scene = scenario.scene()
        robot = scenario.fleet(scene)[0]
        simulator = EchoSimulator(scene, scenario.frame_id, scenario.start_ns)
        pipeline, rng = Pipeline(), np.random.default_rng(1)
        found = []
        for number, (x, y) in enumerate(positions_m):
            stamp_ns = scenario.start_ns + number * SECOND // 10
            sonar = robot.transducers[0]
            trace = simulator.ping(sonar, Pose.planar(5.0, 5.0, 0.3 * number), stamp_ns, rng)
            moved = replace(trace, pose=Pose.planar(x, y, 0.3 * number))
            found.append(pipeline.reconstruct(moved))
        return found

    return make
