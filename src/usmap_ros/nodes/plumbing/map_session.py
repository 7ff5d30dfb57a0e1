"""All that map_fusion has while it is configured: the map, and who works on it."""

import traceback
from typing import Any

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.conversions import cone_from_cdr
from usmap_ros.live.checkpoint import Checkpoint
from usmap_ros.live.health import Health
from usmap_ros.live.live_fusion import LiveFusion
from usmap_ros.mapping.far_off import FarOffError
from usmap_ros.mapping.robot_check.consistency import is_of
from usmap_ros.nodes.plumbing.cone_topics import ForeignCones
from usmap_ros.nodes.plumbing.frames import Transforms
from usmap_ros.nodes.plumbing.map_bringer import MapBringer
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.robot_check import RobotCheck
from usmap_ros.nodes.plumbing.worker import Worker
from usmap_ros.parameters.nodes import MapFusionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.repeats import RepeatedPingError

#: How often it is looked whether a transform has come that a cone waits for.
_RETRY_S = 0.02
#: Why cones are lost, by what they are counted as.
_LOSSES = {
    "dropped": "cones come faster than they are fused",
    "late": "cones came after newer ones had been fused; order_wait_s may be too short, or a"
    " robot's clock wrong",
    "thinned": "pings come from new places faster than they can be explained together: maps that"
    " are made of all of them are made of a share",
}


class MapSession:
    """A map from the node's configuration to its clean-up.

    Cones are taken in one thread and fused in another; a third publishes and keeps the map, so
    that neither waits for large messages or for a disk.

    Parameters
    ----------
    node : LifecycleNode
        On whose topics the map is published.
    parameters : ParameterServer
        Those of the map are taken as they are now, the others as they change.
    health : Health
        Counts what becomes of the cones.
    transforms : Transforms
        For cones in other frames.

    Raises
    ------
    UsmapError
        If the checkpoint cannot be read or written, or does not fit the parameters.
    """

    def __init__(
        self,
        node: Any,
        parameters: ParameterServer[MapFusionParameters],
        health: Health,
        transforms: Transforms,
    ) -> None:
        now = parameters.value
        #: What orders and fuses cones, and holds the map.
        self.fusion = LiveFusion(
            now.mapping,
            now.order_wait_s,
            now.queue_depth,
            now.frame_id,
            on_set_apart=lambda count, cause: health.problem("set apart", cause, number=count),
            poses=now.poses,
        )
        checkpoint = Checkpoint(now.checkpoint_path)
        if now.resume and checkpoint.restore(self.fusion):
            node.get_logger().info(f"resumed the map in {now.checkpoint_path}")
        if checkpoint.trouble:
            health.problem("set aside", checkpoint.trouble)
        self._node = node
        self._parameters = parameters
        self._health = health
        self._foreign_cones = ForeignCones(transforms, health, self._hand_over, self._hold)
        self._noted = dict.fromkeys(_LOSSES, 0)
        self.fusion.leave_out(now.without)
        self._worker = Worker(node, self._step)
        #: Publishes the map and keeps it on disk.
        self.maps = MapBringer(node, parameters, health, self.fusion, checkpoint, transforms)
        #: Tells which robots contradict the others.
        self.check = RobotCheck(node, self.fusion, parameters, health)

    def close(self) -> None:
        """End the work, keep the map on disk, and take its topics back."""
        self.check.stop()
        self._worker.stop()
        self.maps.close()

    def take_over_parameters(self) -> None:
        """Obey those that may change while there is a map."""
        now = self._parameters.value
        self.fusion.queue.set_limits(now.order_wait_s, now.queue_depth)
        self.fusion.leave_out(now.without)
        self._worker.wake()
        self.check.wake()

    def reset(self) -> None:
        """Forget the map."""
        self.fusion.reset()
        self.check.wake()
        self.maps.forget()

    def set_sources(self, present: dict[str, bool]) -> None:
        """Wait for the topics on which somebody publishes."""
        without = self._parameters.value.without
        awaited = {name: here and not is_of(name, without) for name, here in present.items()}
        self.fusion.queue.set_sources(awaited)
        self._worker.wake()

    def receive(self, topic: str, payload: bytes) -> None:
        """Take a cone in, leave it out if that is asked for, or refuse it with the reason."""
        if is_of(topic, self._parameters.value.without):
            self._health.count("left out")
            return
        try:
            cone = cone_from_cdr(payload)
        except MalformedMessageError as error:
            self._health.problem("malformed", f"{topic}: {error}")
            return
        frame_id = self.fusion.frame_id
        # Of a frame that is corrected here, TF says what was said here.
        if frame_id in ("", cone.frame_id) or cone.frame_id in self.fusion.poses.own_frames:
            self._hand_over(topic, cone)
        else:
            wait_s = self._parameters.value.transform_wait_s
            self._foreign_cones.add(topic, cone, frame_id, wait_s)

    def settle(self) -> float | None:
        """Have fused what was received, and cones of other frames whose transforms have come.

        Returns
        -------
        pause_s : float or None
            When to try again; None: not before another cone has come.
        """
        self._foreign_cones.retry(self.fusion.frame_id)
        # Once for all that came together: whoever is woken wants the interpreter at once.
        self._worker.wake()
        return _RETRY_S if len(self._foreign_cones) else None

    def _hand_over(self, topic: str, cone: EchoCone) -> None:
        if not self._parameters.value.is_in_area(*map(float, cone.pose.position_m[:2])):
            self._health.count("elsewhere")
            return
        try:
            self.fusion.receive(topic, cone)
        except RepeatedPingError as error:
            self._health.problem(
                "repeated", f"{topic}: {error}; a second reconstructor, or a bag played again?"
            )
        except MalformedMessageError as error:
            self._health.problem("malformed", f"{topic}: {error}")

    def _hold(self, topic: str, cone: EchoCone) -> bool:
        """Have a say to whoever is in another frame that may be joined, or become the map's."""
        if self.fusion.is_frame_decided and not self.fusion.takes(cone):
            return False
        self._hand_over(topic, cone)
        return True

    def _step(self) -> float | None:
        """Fuse the next cone; runs in the worker's thread."""
        try:
            fused = self.fusion.fuse_next()
        except FarOffError as error:
            self._health.problem("set apart", str(error))
            return 0.0
        except MalformedMessageError as error:
            self._health.problem("malformed", str(error))
            return 0.0
        except Exception as error:  # One odd cone must not end the mapping of all robots.
            self._node.get_logger().error(traceback.format_exc())
            self._health.problem("failed", repr(error), is_error=True)
            return 0.0
        self._note_losses()
        if fused is None:
            return self.fusion.due_in_s()
        self._health.count("fused")
        self._health.latency(fused.latency_s)
        return 0.0

    def _note_losses(self) -> None:
        queue = self.fusion.queue
        now = {"dropped": queue.dropped, "late": queue.late, "thinned": self.fusion.thinned}
        for what, number in now.items():
            if number > self._noted[what]:
                reason = _LOSSES[what]
                if what == "late":
                    reason = f"{queue.last_late}: {reason}"
                self._health.problem(what, reason, number=number - self._noted[what])
        self._noted = now
