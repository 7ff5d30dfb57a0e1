"""Which cone topics there are: listed, or found by their type."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial

from rclpy.node import Node

from usmap_ros.live.interfaces import CONE
from usmap_ros.nodes.plumbing.inbox import Inbox


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
        As of `Inbox`.
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
        self._is_listed = any(listed)
        self._inbox = Inbox(node, after)
        for name in filter(None, listed):
            self._subscribe(node.resolve_topic_name(name))

    @property
    def names(self) -> set[str]:
        """Topics that are listened to."""
        return self._inbox.topics

    def look(self, pattern: str) -> dict[str, bool]:
        """Subscribe to what is new; tells of every topic whether somebody publishes on it.

        Parameters
        ----------
        pattern : str
            Regular expression that whole names must match; others are let go of.
        """
        if not self._is_listed:
            found = {
                name
                for name, types in self._node.get_topic_names_and_types()
                if CONE.message_type in types and re.fullmatch(pattern, name)
            }
            for name in found - self.names:
                self._node.get_logger().info(f"fusing {name}")
                self._subscribe(name)
            # A subscription keeps its own topic alive, so only the pattern ever ends one: a robot
            # that comes back is heard from its first cone on.
            for name in self.names - found:
                self._inbox.remove(name)
        return {name: self._node.count_publishers(name) > 0 for name in sorted(self.names)}

    def destroy(self) -> None:
        """Let go of all topics."""
        self._inbox.close()

    def _subscribe(self, name: str) -> None:
        self._inbox.add(CONE, partial(self._on_cone, name), name)
