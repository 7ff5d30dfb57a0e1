"""Which cone topics there are, listed or found by type, and cones in other frames than the map."""

import time
from collections import deque
from collections.abc import Callable
from functools import partial
from math import inf

from rclpy.node import Node

from usmap_ros.errors import MalformedMessageError
from usmap_ros.live.health import Health
from usmap_ros.live.interfaces import CONE
from usmap_ros.nodes.plumbing.frames import NoTransformError, Transforms
from usmap_ros.nodes.plumbing.open_inbox import open_inbox
from usmap_ros.parameters.nodes.common import is_one_of
from usmap_ros.pings.cone import EchoCone


class ConeTopics:
    """Subscribes to cone topics as they appear; robots may join and leave at any time.

    Cones are taken in a thread of its own.

    Parameters
    ----------
    node : Node
        The node that subscribes, and whose graph is looked at.
    listed : list of str
        Topics to fuse; empty: every one that there is.
    on_cone : callable
        Gets topic and serialized message.
    after : callable
        As of `usmap_ros.nodes.plumbing.inbox.Inbox`.
    """

    def __init__(
        self,
        node: Node,
        listed: list[str],
        on_cone: Callable[[str, bytes], None],
        after: Callable[[], float | None],
    ) -> None:
        self._node = node
        self._on_cone = on_cone
        # When there was somebody who publishes.
        self._heard_s: dict[str, float] = {}
        self._is_listed = any(listed)
        self._inbox = open_inbox(node, after)
        for name in filter(None, listed):
            self._subscribe(node.resolve_topic_name(name))

    @property
    def names(self) -> set[str]:
        """Topics that are listened to."""
        return self._inbox.topics

    def look(self, globs: str, absence_s: float) -> dict[str, bool]:
        """Subscribe to what is new; tells of every topic whether somebody publishes on it.

        Parameters
        ----------
        globs : str
            One of them must match a topic's whole name; others are let go of.
        absence_s : float
            So are those on which nobody has published for so long.  Until then, a robot that comes
            back is heard from its first cone on.
        """
        if not self._is_listed:
            wanted = {
                name
                for name, types in self._node.get_topic_names_and_types()
                if CONE.message_type in types and is_one_of(name, globs)
            }
            now_s = time.monotonic()
            for name in wanted:
                # A subscription keeps its own topic alive: who publishes is what counts.
                if self._node.count_publishers(name):
                    self._heard_s[name] = now_s
            kept = {name for name in wanted if now_s - self._heard_s.get(name, -inf) <= absence_s}
            for name in kept - self.names:
                self._node.get_logger().info(f"fusing {name}")
                self._subscribe(name)
            for name in self.names - kept:
                self._inbox.remove(name)
            self._heard_s = {name: self._heard_s[name] for name in kept}
        return {name: self._node.count_publishers(name) > 0 for name in sorted(self.names)}

    def destroy(self) -> None:
        """Let go of all topics."""
        self._inbox.close()

    def _subscribe(self, name: str) -> None:
        self._inbox.add(CONE, partial(self._on_cone, name), name)


class ForeignCones:
    """Moves cones into the map's frame as soon as their transforms are known, or refuses them.

    Parameters
    ----------
    transforms : Transforms
        TF, if there is any.
    health : Health
        Counts what is refused.
    on_cone : callable
        Gets topic and cone of what could be moved.
    on_stranger : callable
        Gets topic and cone of what could not; whether it has a use for it.
    """

    def __init__(
        self,
        transforms: Transforms,
        health: Health,
        on_cone: Callable[[str, EchoCone], None],
        on_stranger: Callable[[str, EchoCone], bool],
    ) -> None:
        self._transforms = transforms
        self._health = health
        self._on_cone, self._on_stranger = on_cone, on_stranger
        self._waiting: deque[tuple[float, str, EchoCone]] = deque()

    def __len__(self) -> int:
        """Count those that wait."""
        return len(self._waiting)

    def add(self, topic: str, cone: EchoCone, frame_id: str, wait_s: float) -> None:
        """Move a cone into the frame `frame_id`, within `wait_s`."""
        self._waiting.append((time.monotonic() + wait_s, topic, cone))
        self.retry(frame_id)

    def retry(self, frame_id: str) -> None:
        """Move those whose transforms have come by now; refuse those that waited too long."""
        for _ in range(len(self._waiting)):
            deadline_s, topic, cone = self._waiting.popleft()
            try:
                moved = self._transforms.moved(cone, frame_id)
            except (NoTransformError, MalformedMessageError) as error:
                if self._transforms.is_available and time.monotonic() < deadline_s:
                    self._waiting.append((deadline_s, topic, cone))
                    continue
                if self._on_stranger(topic, cone):
                    continue
                self._health.problem(
                    "refused",
                    f"{topic}: its frame is '{cone.frame_id}', the map's is '{frame_id}',"
                    f" and {error}",
                )
            else:
                self._on_cone(topic, moved)
