"""Node that fuses the cones of all robots into one map."""

from __future__ import annotations

import traceback
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from usmap_ros.cone import EchoCone
from usmap_ros.errors import MalformedMessageError, MapFileError, UsmapError
from usmap_ros.io.conversions import cone_from_message
from usmap_ros.live import interfaces
from usmap_ros.live.checkpoint import Checkpoint
from usmap_ros.live.live_fusion import LiveFusion
from usmap_ros.nodes.map_services import MapServices
from usmap_ros.nodes.plumbing.cone_topics import ConeTopics
from usmap_ros.nodes.plumbing.endpoints import every
from usmap_ros.nodes.plumbing.foreign_cones import ForeignCones
from usmap_ros.nodes.plumbing.frames import Transforms
from usmap_ros.nodes.plumbing.health import Health
from usmap_ros.nodes.plumbing.map_publisher import MapPublisher
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.ros_types import interface_class
from usmap_ros.nodes.plumbing.run import run_node
from usmap_ros.nodes.plumbing.worker import Worker
from usmap_ros.parameters.fields import is_among
from usmap_ros.parameters.nodes import MapFusionParameters

_RETRY_S = 0.02
_COUNTED = (
    "received", "fused", "malformed", "refused", "dropped", "late", "paused", "failed", "published"
)  # fmt: skip


class MapFusion(LifecycleNode):
    """From every robot's ``cone`` to ``map``; a managed node that starts by itself.

    Keyword arguments are those of `rclpy.node.Node`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(
            interfaces.MAP_FUSION.name,
            automatically_declare_parameters_from_overrides=True,
            **options,
        )
        self.fusion: LiveFusion | None = None
        self.parameters = ParameterServer(self, MapFusionParameters, self._why_fixed)
        self.parameters.on_change.append(self._take_over_parameters)
        self.health = Health(self, self.parameters.value.diagnostics_period_s, _COUNTED)
        transforms = Transforms(
            self, "cones must be in the map's frame, as the pose in each message is"
        )
        self._foreign_cones = ForeignCones(transforms, self.health, self._hand_over)
        self._is_active = False
        self._map_services = MapServices(self)
        if self.parameters.value.autostart:
            self._start()

    def close(self) -> None:
        """Keep the map, and destroy the node."""
        if self.fusion is not None:
            self._release()
        self.destroy_node()

    # ---- life cycle

    def _start(self) -> None:
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make an empty map, or take up that of the checkpoint."""
        parameters = self.parameters.value
        fusion = LiveFusion(
            parameters.mapping,
            parameters.order_wait_s,
            parameters.queue_depth,
            parameters.frame_id,
        )
        try:
            checkpoint = Checkpoint(parameters.checkpoint_path)
            if parameters.resume and checkpoint.restore(fusion):
                self.get_logger().info(f"resumed the map in {parameters.checkpoint_path}")
        except UsmapError as error:
            self.get_logger().error(f"cannot be configured: {error}")
            return TransitionCallbackReturn.FAILURE
        self.fusion, self._checkpoint = fusion, checkpoint
        self._published_version = 0
        self._noted = {"dropped": 0, "late": 0}
        self.publisher = MapPublisher(self, self._has_map_updates())
        self._worker = Worker(self, self._step)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to listen and to publish."""
        parameters = self.parameters.value
        self._topics = ConeTopics(self, parameters.cone_topics, self._receive)
        self._timers_of_life = [
            every(self, parameters.discovery_period_s, self._look_for_robots),
            every(self, 1.0 / parameters.publish_rate_hz, self._publish_if_changed),
            every(self, parameters.checkpoint_period_s, self._keep),
            every(self, _RETRY_S, self._retry_transforms),
        ]
        self._is_active = True
        result = super().on_activate(state)
        self._look_for_robots()
        # A map that was resumed is there for everybody at once.
        self._publish_if_changed()
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop listening and publishing; the map stays."""
        self._deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Keep the map on disk, and forget it."""
        self._release()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Keep the map on disk."""
        if self.fusion is not None:
            self._release()
        return TransitionCallbackReturn.SUCCESS

    def _deactivate(self) -> None:
        self._is_active = False
        self._topics.destroy()
        for timer in self._timers_of_life:
            self.destroy_timer(timer)

    def _release(self) -> None:
        if self._is_active:
            self._deactivate()
        self._worker.stop()
        self._keep()
        self.publisher.destroy()
        self._foreign_cones.clear()
        self.fusion = None

    # ---- parameters

    def _why_fixed(self, name: str) -> str | None:
        if self.fusion is None or not is_among(name, MapFusionParameters.fixed_while_configured):
            return None
        return (
            "is taken over when the node is configured; deactivate it and clean it up first,"
            f" with 'ros2 lifecycle set {self.get_fully_qualified_name()} ...'"
        )

    def _take_over_parameters(self) -> None:
        parameters = self.parameters.value
        if self.fusion is not None:
            self.fusion.set_limits(parameters.order_wait_s, parameters.queue_depth)
        if self._is_active:
            periods_s = (
                parameters.discovery_period_s,
                1.0 / parameters.publish_rate_hz,
                parameters.checkpoint_period_s,
            )
            for timer, period_s in zip(self._timers_of_life, periods_s, strict=False):
                timer.timer_period_ns = round(period_s * 1e9)

    def _has_map_updates(self) -> bool:
        if not self.parameters.value.publish_updates:
            return False
        try:
            interface_class(interfaces.MAP_UPDATES.message_type)
        except ImportError:
            self.get_logger().warning("map_msgs is not installed: map_updates is not published")
            return False
        return True

    # ---- cones

    def _look_for_robots(self) -> None:
        assert self.fusion is not None
        self.fusion.set_sources(self._topics.look(self.parameters.value.topic_pattern))
        self._worker.wake()

    def _receive(self, topic: str, message: Any) -> None:
        self.health.received()
        if self._map_services.is_paused:
            self.health.count("paused")
            return
        try:
            cone = cone_from_message(message)
        except MalformedMessageError as error:
            self.health.problem("malformed", f"{topic}: {error}")
            return
        assert self.fusion is not None
        if self.fusion.frame_id in ("", cone.frame_id):
            self._hand_over(topic, cone)
        else:
            self._foreign_cones.add(
                topic, cone, self.fusion.frame_id, self.parameters.value.transform_wait_s
            )

    def _retry_transforms(self) -> None:
        assert self.fusion is not None
        self._foreign_cones.retry(self.fusion.frame_id)

    def _hand_over(self, topic: str, cone: EchoCone) -> None:
        assert self.fusion is not None
        try:
            self.fusion.receive(topic, cone)
        except MalformedMessageError as error:
            self.health.problem("malformed", f"{topic}: {error}")
        else:
            self._worker.wake()

    def _step(self) -> float | None:
        """Fuse the next cone; runs in the worker's thread."""
        assert self.fusion is not None
        try:
            fused = self.fusion.fuse_next()
        except MalformedMessageError as error:
            self.health.problem("malformed", str(error))
            return 0.0
        except Exception as error:  # One odd cone must not end the mapping of all robots.
            self.get_logger().error(traceback.format_exc())
            self.health.problem("failed", repr(error), is_error=True)
            return 0.0
        self._note_losses()
        if fused is None:
            return self.fusion.due_in_s()
        self.health.count("fused")
        self.health.latency(fused.latency_s)
        return 0.0

    def _note_losses(self) -> None:
        assert self.fusion is not None
        now = {"dropped": self.fusion.dropped, "late": self.fusion.late}
        reasons = {
            "dropped": "cones come faster than they are fused",
            "late": "cones came after newer ones had been fused; order_wait_s may be too short",
        }
        for what, number in now.items():
            if number > self._noted[what]:
                self.health.problem(what, reasons[what], number=number - self._noted[what])
        self._noted = now

    # ---- maps

    def _publish_if_changed(self) -> None:
        assert self.fusion is not None
        version = self.fusion.version
        if version == self._published_version:
            return
        occupancy = self.fusion.occupancy_map()
        if not occupancy.frame_id:
            return
        self._published_version = version
        try:
            self.publisher.publish(occupancy)
        except MalformedMessageError as error:
            self.health.problem("unpublished", f"map: {error}", is_error=True)
        else:
            self.health.count("published")

    def _keep(self) -> None:
        """Write the checkpoint if the map has changed."""
        assert self.fusion is not None
        try:
            self._checkpoint.keep(self.fusion)
        except MapFileError as error:
            self.health.problem("not kept", str(error), is_error=True)


def main() -> None:
    """Run the node."""
    run_node(MapFusion)


if __name__ == "__main__":
    main()
