"""Node that fuses the cones of all robots into one map."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from usmap_ros.errors import MapFileError, MapSizeError, UsmapError
from usmap_ros.io.map_files import NAV2_FILE, map_folder, save_map
from usmap_ros.live.backlog import ROOM, WAITING
from usmap_ros.live.health import Level, Remark
from usmap_ros.live.interfaces import GET_MAP, MAP_FUSION, PAUSE, RESET, SAVE_MAP
from usmap_ros.nodes.plumbing.cone_topics import ConeTopics
from usmap_ros.nodes.plumbing.diagnostics import NodeHealth
from usmap_ros.nodes.plumbing.endpoints import every, serve
from usmap_ros.nodes.plumbing.frames import Transforms
from usmap_ros.nodes.plumbing.map_session import MapSession
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.run import run_node
from usmap_ros.nodes.plumbing.standstill import Standstill
from usmap_ros.parameters.fields import is_among
from usmap_ros.parameters.nodes import MapFusionParameters

#: How often it is looked whether time passes.
_CLOCK_PERIOD_S = 0.5
#: Of the time that the map on disk may lag behind, when the next checkpoint is begun: the rest is
#: for writing it, and for what else there is to do.
_BEGUN_AFTER = 0.75
_COUNTED = (
    "received", "fused", "malformed", "refused", "repeated", "dropped", "late", "thinned",
    "paused", "failed", "left out", "elsewhere", "set apart", "jumped", "published",
)  # fmt: skip


class MapFusion(LifecycleNode):
    """From every robot's ``cone`` to ``map``; a managed node that starts by itself.

    Keyword arguments are those of `rclpy.node.Node`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(
            MAP_FUSION.name, automatically_declare_parameters_from_overrides=True, **options
        )
        #: The map and who works on it; None unless the node is configured.
        self.session: MapSession | None = None
        self._topics: ConeTopics | None = None
        self._timers_of_life: list[Any] = []
        self._is_paused = False
        self._why_unconfigured = ""
        self.parameters = ParameterServer(self, MapFusionParameters, self._why_fixed)
        self.parameters.on_change.append(self._take_over_parameters)
        self.health = NodeHealth(self, self.parameters.value.diagnostics_period_s, _COUNTED)
        self.health.watch(self._state)
        self.health.watch(self._slowness)
        self.health.watch(self._suspected_robots)
        self.health.tell("robots", lambda: self.session.check.summary() if self.session else "")
        self.health.tell("doubted", lambda: self.session.fusion.doubted if self.session else "")
        self.health.tell(
            "common errors", lambda: self.session.fusion.common_error if self.session else ""
        )
        self.health.tell("poses", self._states)
        self.health.tell(WAITING, lambda: self.session.fusion.waiting if self.session else 0)
        self.health.tell(ROOM, lambda: self.parameters.value.queue_depth)
        self._transforms = Transforms(
            self, "cones must be in the map's frame, as the pose in each message is"
        )
        serve(self, GET_MAP, self._get_map)
        serve(self, SAVE_MAP, self._save_map)
        serve(self, RESET, self._reset)
        serve(self, PAUSE, self._pause)
        if self.parameters.value.autostart:
            self._start()

    def close(self) -> None:
        """Keep the map on disk."""
        self._release()

    # ---- life cycle

    def _start(self) -> None:
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make an empty map, or take up that of the checkpoint."""
        try:
            self.session = MapSession(self, self.parameters, self.health, self._transforms)
        except UsmapError as error:
            self._why_unconfigured = str(error)
            self.get_logger().error(f"cannot be configured: {error}")
            return TransitionCallbackReturn.FAILURE
        self._why_unconfigured = ""
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to listen and to publish."""
        session = self.session
        assert session is not None  # Only what is configured is activated.
        receive = partial(self._receive, session)
        listed = self.parameters.value.cone_topics
        self._topics = topics = ConeTopics(self, listed, receive, session.settle)
        look = partial(self._look_for_robots, session, topics)
        watch = partial(_note_standstill, session, Standstill(self))
        callbacks: tuple[Callable[[], None], ...] = (
            look, session.maps.publish, session.maps.keep, watch,
        )  # fmt: skip
        self._timers_of_life = [
            every(self, period_s, callback)
            for period_s, callback in zip(self._periods_s(), callbacks, strict=True)
        ]
        result = super().on_activate(state)
        look()
        # A map that was resumed is there for everybody at once.
        session.maps.publish_again()
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
        self._release()
        return TransitionCallbackReturn.SUCCESS

    def _deactivate(self) -> None:
        for timer in self._timers_of_life:
            self.destroy_timer(timer)
        self._timers_of_life = []
        if self._topics is not None:
            self._topics.destroy()
            self._topics = None

    def _release(self) -> None:
        self._deactivate()
        if self.session is not None:
            self.session.close()
            self.session = None

    # ---- health

    def _state(self) -> Remark | None:
        """Whether the node maps at all."""
        if self._why_unconfigured:
            return Remark(Level.ERROR, f"nothing is mapped: {self._why_unconfigured}")
        if self.session is None:
            return Remark(Level.WARN, "nothing is mapped: the node is not configured")
        if self._topics is None:
            return Remark(Level.WARN, "nothing is mapped: the node is not active")
        if self._is_paused:
            return Remark(Level.WARN, "nothing is mapped: paused")
        return self.health.silence("no cone has come from any robot")

    def _slowness(self) -> Remark | None:
        """Whether it falls behind, the wait that is asked for left aside."""
        now = self.parameters.value
        return self.health.slowness(now.order_wait_s + now.latency_limit_s)

    def _states(self) -> str:
        """Which robots' poses are corrected, and whether they are joined or alone."""
        return self.session.fusion.poses.latest.states() if self.session else ""

    def _suspected_robots(self) -> Remark | None:
        """Which robots contradict the others."""
        return None if self.session is None else self.session.check.suspects()

    # ---- parameters

    def _why_fixed(self, name: str) -> str | None:
        if self.session is None or not is_among(name, MapFusionParameters.fixed_while_configured):
            return None
        return (
            "is taken over when the node is configured; deactivate it and clean it up first,"
            f" with 'ros2 lifecycle set {self.get_fully_qualified_name()} ...'"
        )

    def _take_over_parameters(self) -> None:
        if self.session is not None:
            self.session.take_over_parameters()
        # There are none unless the node is active.
        for timer, period_s in zip(self._timers_of_life, self._periods_s(), strict=False):
            timer.timer_period_ns = round(period_s * 1e9)

    def _periods_s(self) -> tuple[float, ...]:
        """How often an active node looks for robots, publishes, keeps the map, looks at time."""
        now = self.parameters.value
        begun_s = _BEGUN_AFTER * now.checkpoint_period_s
        return now.discovery_period_s, 1.0 / now.publish_rate_hz, begun_s, _CLOCK_PERIOD_S

    # ---- cones

    def _look_for_robots(self, session: MapSession, topics: ConeTopics) -> None:
        now = self.parameters.value
        session.set_sources(topics.look(now.topic_pattern, now.absence_s))

    def _receive(self, session: MapSession, topic: str, payload: bytes) -> None:
        self.health.work("received")
        if self._is_paused:
            self.health.count("paused")
        else:
            session.receive(topic, payload)

    # ---- services, which are there whatever the node's state

    def _get_map(self, request: Any, response: Any) -> Any:
        """Fill in the map; without one, the response stays empty."""
        grid = None if self.session is None else self.session.maps.message()
        if grid is not None:
            response.map = grid
        return response

    def _save_map(self, request: Any, response: Any) -> Any:
        if self.session is None:
            response.message = "the node is not configured"
            return response
        path = Path(self.parameters.value.save_path).expanduser()
        try:
            with map_folder(path):
                save_map(path, self.session.fusion.occupancy_map())
        except (MapFileError, MapSizeError) as error:
            response.message = str(error)
        else:
            response.success, response.message = True, str((path / NAV2_FILE).absolute())
        return response

    def _reset(self, request: Any, response: Any) -> Any:
        if self.session is not None:
            self.session.reset()
        return response

    def _pause(self, request: Any, response: Any) -> Any:
        self._is_paused = bool(request.data)
        response.success = True
        response.message = "paused: cones are not fused" if self._is_paused else "fusing"
        return response


def _note_standstill(session: MapSession, is_standing: Standstill) -> None:
    if is_standing():
        session.fusion.queue.stand_still()


def main() -> None:
    """Run the node."""
    run_node(MapFusion, has_loops=True, looks_for_topics=True)


if __name__ == "__main__":
    main()
