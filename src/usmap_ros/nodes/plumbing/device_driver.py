"""What drivers of real hardware share: pose, pace, and devices that are lost and come back."""

import time
from abc import abstractmethod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from rclpy.node import Node

from usmap_ros.drivers import DeviceError, NoAnswerError, PingSource
from usmap_ros.errors import ConfigurationError, MalformedMessageError
from usmap_ros.importing import Recording, Sensor, unit_problem
from usmap_ros.live.health import Level, Remark
from usmap_ros.nodes.plumbing.diagnostics import NodeHealth
from usmap_ros.nodes.plumbing.echo_outputs import EchoOutputs
from usmap_ros.nodes.plumbing.frames import Transforms
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.pose_sources import (
    NoPoseError,
    OdometryPose,
    PoseSource,
    TransformPose,
)
from usmap_ros.nodes.plumbing.worker import Worker
from usmap_ros.parameters.nodes import DeviceDriverParameters

#: Pause after which a lost device is first looked for.
_FIRST_PAUSE_S = 0.5
#: Pings without an answer after which a device is opened anew: that resets many a microcontroller.
_MOST_UNANSWERED = 5


class DeviceDriver(Node):
    """Lets a device ping, in a thread of its own, and publishes ``echo`` and ``range``.

    A driver is a subclass with a name and with `make_source`.  Keyword arguments are those of
    `rclpy.node.Node`.

    Raises
    ------
    ConfigurationError
        If the sensor is not described, or not as it can be.
    """

    #: Name of the node.
    name: ClassVar[str]
    #: Its parameters.
    group: ClassVar[type[DeviceDriverParameters]] = DeviceDriverParameters

    def __init__(self, **options: Any) -> None:
        super().__init__(self.name, automatically_declare_parameters_from_overrides=True, **options)
        self.parameters = ParameterServer(self, self.group)
        parameters = self.parameters.value
        self.health = NodeHealth(
            self,
            parameters.diagnostics_period_s,
            ("received", "published", "malformed", "unanswered", "disconnected", "without pose"),
        )
        self.health.watch(self._look_at_device)
        self.health.watch(lambda: self.health.silence("no ping; is its pose known?"))
        sensor = Sensor(self._load_description())
        self._base_frame = parameters.base_frame or f"{sensor.robot}/base_link"
        self._pose_source = self._make_pose_source(sensor.frame_id)
        self._outputs = EchoOutputs(self, self.health, {sensor.child_frame_id: ""})
        self._source = self.make_source(sensor)
        self._lost = "not opened yet"
        self._pause_s = _FIRST_PAUSE_S
        self._unanswered = 0
        self._worker = Worker(self, self._step)

    @abstractmethod
    def make_source(self, sensor: Sensor) -> PingSource:
        """What pings, given what is known of the sensor; it need not be there yet."""

    def close(self) -> None:
        """Let go of the device after the ping at hand."""
        self._worker.stop()
        self._source.close()

    def _load_description(self) -> Recording:
        if not self.parameters.value.sensor:
            raise self.parameters.refused("sensor", "is missing")
        path = Path(self.parameters.value.sensor).expanduser()
        description = Recording.load(path)
        samples = description.samples
        for name in ("sample_rate_hz", "full_scale"):
            if not getattr(samples, name):
                raise ConfigurationError(path, f"samples.{name}: is missing")
        # Samples and poses are to come: what is stated is looked at alone.
        still = {name: np.zeros(1) for name in ("time_s", "x_m", "y_m", "z_m", "yaw_rad")}
        problem = unit_problem(description, 0.0, False, np.inf, samples.sample_rate_hz, still)
        if problem:
            raise ConfigurationError(path, problem)
        return description

    def _make_pose_source(self, world: str) -> PoseSource:
        parameters = self.parameters.value
        if parameters.pose_source == "odometry":
            return OdometryPose(self, self.health, parameters.pose_timeout_s)
        transforms = Transforms(self, "the robot's pose cannot be taken from TF")
        transforms.require(self.parameters)
        return TransformPose(transforms, self._base_frame, world, parameters.pose_timeout_s)

    def _look_at_device(self) -> Remark | None:
        return Remark(Level.ERROR, f"disconnected: {self._lost}") if self._lost else None

    def _step(self) -> float:
        """Open the device, or let it ping; the time until the next step (s)."""
        begun_s = time.monotonic()
        if self._lost:
            pause_s = self._open()
        else:
            self._ping()
            pause_s = 1.0 / self.parameters.value.ping_rate_hz
        return max(0.0, begun_s + pause_s - time.monotonic())

    def _open(self) -> float:
        """Try to open the device; how long to wait then (s)."""
        try:
            self._source.open()
        except DeviceError as error:
            self._lose(str(error))
            pause_s = self._pause_s
            self._pause_s = min(2.0 * pause_s, self.parameters.value.longest_pause_s)
            return pause_s
        self.get_logger().info("the device is there")
        self._lost, self._unanswered = "", 0
        return 0.0

    def _lose(self, cause: str) -> None:
        self._source.close()
        self._lost = cause
        self.health.problem("disconnected", cause, is_error=True)

    def _ping(self) -> None:
        now_ns = self.get_clock().now().nanoseconds
        try:
            base, _ = self._pose_source.sample(now_ns, 0.0)
            traces = self._source.ping(now_ns, base)
        except NoPoseError as error:
            self.health.problem("without pose", str(error))
        except MalformedMessageError as error:
            self.health.problem("malformed", str(error))
        except NoAnswerError as error:
            self.health.problem("unanswered", str(error))
            self._unanswered += 1
            if self._unanswered >= _MOST_UNANSWERED:
                self._lose(str(error))
        except DeviceError as error:
            self._lose(str(error))
        else:
            self._pause_s, self._unanswered = _FIRST_PAUSE_S, 0
            self._outputs.publish(traces, with_ranges=self.parameters.value.publish_range)
