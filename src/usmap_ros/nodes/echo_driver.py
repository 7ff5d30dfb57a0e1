"""Node that simulates the transducers of one robot."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node

from usmap_ros.arrays import FloatArray
from usmap_ros.errors import ConfigurationError, MalformedMessageError
from usmap_ros.geometry import Pose
from usmap_ros.io.conversions import array_to_message, range_to_message, trace_to_message
from usmap_ros.live.interfaces import ECHO, ECHO_DRIVER, RANGE, TRANSDUCERS
from usmap_ros.live.scenario_time import NoTimeError, ScenarioTime
from usmap_ros.nodes.plumbing.diagnostics import NodeHealth
from usmap_ros.nodes.plumbing.endpoints import advertise, within
from usmap_ros.nodes.plumbing.frames import Transforms
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.pose_sources import (
    NoPoseError,
    OdometryPose,
    PathPose,
    PoseSource,
    TransformPose,
)
from usmap_ros.nodes.plumbing.robot_frames import RobotFrames
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes
from usmap_ros.nodes.plumbing.run import run_node
from usmap_ros.parameters.nodes import EchoDriverParameters
from usmap_ros.pipeline import Pipeline
from usmap_ros.simulation import EchoSimulator, MountedTransducer, Scenario
from usmap_ros.simulation.robot import SimulatedRobot
from usmap_ros.simulation.simulator import NANOSECONDS


@dataclass
class _Sonar:
    """A transducer, where its messages go, and its noise."""

    mounted: MountedTransducer
    rng: np.random.Generator
    echo: Any
    range: Any
    last_stamp_ns: int = -1


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
        self._types = RosMessageTypes()
        self._pipeline = Pipeline()
        scenario = self._load_scenario()
        scene = scenario.scene()
        fleet = scenario.fleet(scene)
        self._robot = robot = self._choose(fleet)
        self._others = scenario.heard_by(robot, fleet)
        self._world = scenario.frame_id
        self._scene = scene
        self._time = self._make_time()
        self._transforms = self._make_transforms()
        base_frame = parameters.base_frame or f"{robot.name}/base_link"
        self._pose_source = self._make_pose_source(robot, base_frame)
        self._frames = self._make_frames(robot, base_frame)
        sonars = self._make_sonars(robot)
        self._array = robot.shared_array(0)
        self._errors = np.random.default_rng(robot.error_seed)
        # One at a time, unless they are meant to hear one another.
        turns = [sonars] if robot.simultaneous else [[sonar] for sonar in sonars]
        self._turns = cycle(turns)
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
                raise ConfigurationError(
                    f"parameters of {self.get_fully_qualified_name()}", str(error)
                ) from error
        return time

    def _load_scenario(self) -> Scenario:
        path = self.parameters.value.scenario
        if not path:
            raise ConfigurationError(
                f"parameters of {self.get_fully_qualified_name()}", "scenario: is missing"
            )
        return Scenario.load(Path(path).expanduser())

    def _choose(self, fleet: list[SimulatedRobot]) -> SimulatedRobot:
        name = self.parameters.value.robot
        for robot in fleet:
            if name in ("", robot.name):
                return robot
        known = ", ".join(robot.name for robot in fleet)
        raise ConfigurationError(
            f"parameters of {self.get_fully_qualified_name()}",
            f"robot: is {name!r}, the scenario has {known}",
        )

    def _make_transforms(self) -> Transforms | None:
        """TF, if anything needs it."""
        parameters = self.parameters.value
        if parameters.pose_source != "tf" and not parameters.publish_tf:
            return None
        transforms = Transforms(self, "neither is the robot's pose taken from TF nor published")
        if parameters.pose_source == "tf" and not transforms.is_available:
            raise ConfigurationError(
                f"parameters of {self.get_fully_qualified_name()}",
                "pose_source: is 'tf', and tf2_ros is not installed; 'odometry' needs no TF",
            )
        return transforms

    def _make_pose_source(self, robot: SimulatedRobot, base_frame: str) -> PoseSource:
        parameters = self.parameters.value
        if parameters.pose_source == "odometry":
            return OdometryPose(self, self.health, parameters.pose_timeout_s)
        if parameters.pose_source == "tf" and self._transforms is not None:
            return TransformPose(
                self._transforms, base_frame, self._world, parameters.pose_timeout_s
            )
        return PathPose(robot.motion)

    def _make_frames(self, robot: SimulatedRobot, base_frame: str) -> RobotFrames | None:
        parameters = self.parameters.value
        if not parameters.publish_tf or self._transforms is None:
            return None
        mounts = {sonar.child_frame_id: sonar.mount for sonar in robot.transducers}
        return RobotFrames(
            self._transforms,
            self._world,
            base_frame,
            mounts if parameters.publish_transducer_tf else {},
            # Where TF says where the base is, somebody else broadcasts it.
            parameters.publish_base_tf and parameters.pose_source != "tf",
        )

    def _make_sonars(self, robot: SimulatedRobot) -> list[_Sonar]:
        sonars = []
        for mounted, seed in zip(robot.transducers, robot.noise_seeds, strict=True):
            # The robot's name is the node's namespace; with several transducers each has its own.
            is_alone = len(robot.transducers) == 1
            namespace = "" if is_alone else mounted.child_frame_id.rpartition("/")[2]
            sonars.append(
                _Sonar(
                    mounted,
                    np.random.default_rng(seed),
                    advertise(self, ECHO, within(namespace, ECHO)),
                    advertise(self, RANGE, within(namespace, RANGE)),
                )
            )
        return sonars

    def _announce(self, robot: SimulatedRobot) -> None:
        """Publish what traces do not say of the transducers."""
        publisher = advertise(self, TRANSDUCERS)
        for array in robot.arrays(0):
            publisher.publish(array_to_message(array, self._types))

    def _ping(self) -> None:
        """Let the next transducer ping, or all of them."""
        turn = next(self._turns)
        now_ns = self.get_clock().now().nanoseconds
        try:
            base, stamp_ns = self._pose_source.sample(now_ns, self._time.at(now_ns))
        except (NoTimeError, NoPoseError) as error:
            self.health.problem("without pose", str(error))
            return
        if stamp_ns == turn[0].last_stamp_ns:
            return  # Nothing new is known of where it is.
        if self._frames is not None:
            self._frames.move(base, stamp_ns)
        pose_error = None if self._array is None else self._errors.standard_normal(3)
        for sonar in turn:
            self._listen(sonar, base, stamp_ns, pose_error)

    def _listen(
        self, sonar: _Sonar, base: Pose, stamp_ns: int, pose_error: FloatArray | None
    ) -> None:
        """Publish what a transducer hears."""
        sonar.last_stamp_ns = stamp_ns
        pose = base.compose(sonar.mounted.mount)
        # Its moving objects set off with the scenario, whose start follows jumps of the clock.
        simulator = EchoSimulator(self._scene, self._world, self._time.start_ns)
        time_s = (stamp_ns - self._time.start_ns) / NANOSECONDS
        trace = simulator.ping(
            sonar.mounted,
            pose,
            stamp_ns,
            sonar.rng,
            array=self._array,
            pose_error=pose_error,
            velocity_m_s=self._robot.velocity_m_s(time_s, sonar.mounted),
            intruders=[
                one for other in self._others for one in other.intrusions(sonar.mounted, time_s)
            ],
        )
        sonar.echo.publish(trace_to_message(trace, self._types))
        self.health.work("published")
        # Finding the first echo costs more than simulating it: only if somebody listens.
        if self.parameters.value.publish_range and sonar.range.get_subscription_count():
            try:
                cone = self._pipeline.reconstruct(trace)
            except MalformedMessageError as error:
                self.health.problem("malformed", f"the scenario's own trace: {error}")
            else:
                sonar.range.publish(range_to_message(cone, self._types))


def main() -> None:
    """Run the node."""
    run_node(EchoDriver)


if __name__ == "__main__":
    main()
