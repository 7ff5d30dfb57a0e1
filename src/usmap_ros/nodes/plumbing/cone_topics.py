"""Which cone topics there are: listed, or found by their type."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from usmap_ros.live.interfaces import CONE
from usmap_ros.nodes.plumbing.endpoints import subscribe


class ConeTopics:
    """Subscribes to cone topics as they appear; robots may join and leave at any time.

    Parameters
    ----------
    node : Node
        Who subscribes.
    listed : list of str
        Topics to fuse; empty: every one that there is.
    on_cone : callable
        Gets topic and message.
    """

    def __init__(self, node: Node, listed: list[str], on_cone: Callable[[str, Any], None]) -> None:
        self._node = node
        self._on_cone = on_cone
        self._is_listed = any(listed)
        self._subscriptions: dict[str, Any] = {}
        for name in filter(None, listed):
            self._subscribe(node.resolve_topic_name(name))

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
            for name in found - self._subscriptions.keys():
                self._node.get_logger().info(f"fusing {name}")
                self._subscribe(name)
            # A subscription keeps its own topic alive, so only the pattern ever ends one: a robot
            # that comes back is heard from its first cone on.
            for name in self._subscriptions.keys() - found:
                self._node.destroy_subscription(self._subscriptions.pop(name))
        return {name: self._node.count_publishers(name) > 0 for name in sorted(self._subscriptions)}

    def destroy(self) -> None:
        """Let go of all topics."""
        for subscription in self._subscriptions.values():
            self._node.destroy_subscription(subscription)
        self._subscriptions.clear()

    def _subscribe(self, name: str) -> None:
        self._subscriptions[name] = subscribe(
            self._node, CONE, lambda message: self._on_cone(name, message), name
        )
