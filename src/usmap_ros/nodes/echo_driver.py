"""Node that simulates the transducers of one robot."""

from itertools import cycle
from pathlib import Path
from typing import Any

from rclpy.node import Node

from usmap_ros.drivers import PingSource
from usmap_ros.drivers.simulated import SimulatedTransducers, SimulatedWorld
from usmap_ros.io.conversions import array_to_cdr
from usmap_ros.live.interfaces import ECHO_DRIVER, TRANSDUCERS
from usmap_ros.live.scenario_time import NoTimeError, ScenarioTime
from usmap_ros.nodes.plumbing.diagnostics import NodeHealth
from usmap_ros.nodes.plumbing.echo_outputs import EchoOutputs
from usmap_ros.nodes.plumbing.endpoints import advertise
from usmap_ros.nodes.plumbing.frames import Transforms
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.pose_sources import (
    NoPoseError,
    OdometryPose,
    PathPose,
    PoseSource,
    TransformPose,
)
from usmap_ros.nodes.plumbing.run import run_node
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters.nodes import EchoDriverParameters
from usmap_ros.simulation import Scenario
from usmap_ros.simulation.robot import SimulatedRobot
from usmap_ros.simulation.scene import Scene


class EchoDriver(Node):
    """Publishes ``echo`` and ``range`` of a robot in a scenario's world.

    Keyword arguments are those of `rclpy.node.Node`.

    Raises
    ------
    UsmapError
        If the scenario is unusable, or has no such robot.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(
            ECHO_DRIVER.name, automatically_declare_parameters_from_overrides=True, **options
        )
        self.parameters = ParameterServer(self, EchoDriverParameters)
        parameters = self.parameters.value
        self.health = NodeHealth(
            self,
            parameters.diagnostics_period_s,
            ("received", "malformed", "published", "without pose"),
        )
        self.health.watch(
            lambda: self.health.silence("no ping; its pose is not known, or time stands still")
        )
        scenario = self._load_scenario()
        scene = scenario.scene()
        fleet = scenario.fleet(scene)
        robot = self._choose(fleet)
        self._world = scenario.frame_id
        self._time = self._make_time()
        self._transforms = self._make_transforms()
        self._base_frame = parameters.base_frame or f"{robot.name}/base_link"
        self._pose_source = self._make_pose_source(robot)
        self._broadcast_mounts(robot)
        self._outputs = EchoOutputs(self, self.health, _namespaces(robot))
        turns = self._make_turns(robot, scene, scenario.heard_by(robot, fleet))
        self._turns = cycle(turns)
        self._latest_ns: dict[PingSource, int] = {}
        self._announce(robot)
        rate_hz = parameters.ping_rate_hz or 1.0 / robot.ping_interval_s
        self.create_timer(1.0 / (rate_hz * len(turns)), self._ping)

    def close(self) -> None:
        """Nothing is lost with a driver."""

    def _make_time(self) -> ScenarioTime:
        """When the scenario begins; a start too long ago is refused, if the clock says so yet."""
        time = ScenarioTime(round(self.parameters.value.start_time_s * 1e9))
        now_ns = self.get_clock().now().nanoseconds
        if self.parameters.value.start_time_s and now_ns > 0:
            try:
                time.at(now_ns)
            except NoTimeError as error:
                raise self.parameters.refused("start_time_s", str(error)) from error
        return time

    def _load_scenario(self) -> Scenario:
        path = self.parameters.value.scenario
        if not path:
            raise self.parameters.refused("scenario", "is missing")
        return Scenario.load(Path(path).expanduser())

    def _choose(self, fleet: list[SimulatedRobot]) -> SimulatedRobot:
        name = self.parameters.value.robot
        for robot in fleet:
            if name in ("", robot.name):
                return robot
        known = ", ".join(robot.name for robot in fleet)
        raise self.parameters.refused("robot", f"is {name!r}, the scenario has {known}")

    def _make_transforms(self) -> Transforms | None:
        """TF, if anything needs it."""
        parameters = self.parameters.value
        if parameters.pose_source != "tf" and not parameters.publish_tf:
            return None
        transforms = Transforms(self, "neither is the robot's pose taken from TF nor published")
        if parameters.pose_source == "tf":
            transforms.require(self.parameters)
        return transforms

    def _make_pose_source(self, robot: SimulatedRobot) -> PoseSource:
        parameters = self.parameters.value
        if parameters.pose_source != "path" and robot.odometry is not None:
            raise self.parameters.refused(
                "pose_source",
                f"is {parameters.pose_source}, but the scenario gives {robot.name!r} odometry of"
                " its own, which follows its path",
            )
        if parameters.pose_source == "odometry":
            return OdometryPose(self, self.health, parameters.pose_timeout_s)
        if parameters.pose_source == "tf" and self._transforms is not None:
            return TransformPose(
                self._transforms, self._base_frame, self._world, parameters.pose_timeout_s
            )
        return PathPose(robot.motion)

    def _broadcast_mounts(self, robot: SimulatedRobot) -> None:
        """Say where the transducers are on the robot's base: once, for good."""
        parameters = self.parameters.value
        if self._transforms and parameters.publish_tf and parameters.publish_transducer_tf:
            mounts = {sonar.child_frame_id: sonar.mount for sonar in robot.transducers}
            self._transforms.broadcast_for_good(self._base_frame, mounts)

    def _broadcast_base(self, base: Pose, stamp_ns: int) -> None:
        """Say where the robot truly is, unless TF says so: then somebody else broadcasts it."""
        parameters = self.parameters.value
        is_ours = parameters.publish_base_tf and parameters.pose_source != "tf"
        if self._transforms and parameters.publish_tf and is_ours:
            self._transforms.broadcast(base, self._world, self._base_frame, stamp_ns)

    def _make_turns(
        self, robot: SimulatedRobot, scene: Scene, others: list[SimulatedRobot]
    ) -> list[PingSource]:
        """Transducers one at a time, unless they are meant to hear one another."""
        world = SimulatedWorld(scene, self._world, self._time, robot, others)
        sonars = list(zip(robot.transducers, robot.noise_seeds, strict=True))
        groups = [sonars] if robot.simultaneous else [[sonar] for sonar in sonars]
        return [SimulatedTransducers(world, group) for group in groups]

    def _announce(self, robot: SimulatedRobot) -> None:
        """Publish what traces do not say of the transducers."""
        publisher = advertise(self, TRANSDUCERS)
        for array in robot.arrays(0):
            publisher.publish(array_to_cdr(array))

    def _ping(self) -> None:
        """Let the next transducer ping, or all of them."""
        turn = next(self._turns)
        now_ns = self.get_clock().now().nanoseconds
        try:
            base, stamp_ns = self._pose_source.sample(now_ns, self._time.at(now_ns))
        except (NoTimeError, NoPoseError) as error:
            self.health.problem("without pose", str(error))
            return
        if stamp_ns == self._latest_ns.get(turn):
            return  # Nothing new is known of where it is.
        self._latest_ns[turn] = stamp_ns
        self._broadcast_base(base, stamp_ns)
        self._outputs.publish(
            turn.ping(stamp_ns, base), with_ranges=self.parameters.value.publish_range
        )


def _namespaces(robot: SimulatedRobot) -> dict[str, str]:
    """What the topics of each transducer begin with, by its frame.

    The robot's name is the node's namespace; with several transducers each has its own.
    """
    frame_ids = [sonar.child_frame_id for sonar in robot.transducers]
    if len(frame_ids) == 1:
        return {frame_ids[0]: ""}
    return {frame_id: frame_id.rpartition("/")[2] for frame_id in frame_ids}


def main() -> None:
    """Run the node."""
    run_node(EchoDriver)


if __name__ == "__main__":
    main()
