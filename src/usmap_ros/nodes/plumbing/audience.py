"""Who listens to a replay, as far as the graph of ROS tells."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node

from usmap_ros.live.interfaces import CONE_RECONSTRUCTOR

#: What rclpy calls the node of an endpoint before that node has said which endpoints it has.
_UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"


@dataclass(frozen=True)
class Audience:
    """Tells which recorded topics have listeners, and whose traces become cones.

    Endpoints, their matches and the names of their nodes become known one by one.  Whatever is
    matched without being known yet counts as missing: taken for a listener that makes no cones, a
    reconstructor would be left behind by a replay that waits for nobody.
    """

    #: The node that replays.
    node: Node
    #: Its publishers by topic.
    publishers: Mapping[str, Any]
    #: Topics of the cones that may be made of recorded traces, by those of the traces.  The node
    #: listens to them.
    cone_topics: Mapping[str, str]

    def read(self) -> dict[str, str]:
        """Topics of traces that become cones, or are about to, and of those cones."""
        return {
            traces: cones
            for traces, cones in self.cone_topics.items()
            if self.node.count_publishers(cones) or CONE_RECONSTRUCTOR.name in self._readers(traces)
        }

    def makers(self) -> dict[str, int]:
        """Nodes that make cones, by their full names, and how many subscribers those have."""
        return {
            endpoint.node_namespace.rstrip("/") + "/" + endpoint.node_name: (
                self.node.count_subscribers(cones)
            )
            for cones in self.read().values()
            for endpoint in self.node.get_publishers_info_by_topic(cones)
        }

    def missing(self) -> list[str]:
        """Topics that nobody is seen to listen to, or to publish, who should."""
        read = self.read()
        missing = [
            *(topic for topic, publisher in self.publishers.items() if not _matches(publisher)),
            *(traces for traces in self.cone_topics if not self._all_are_known(traces)),
            # One who listens to the cones is the replay itself.
            *(cones for cones in read.values() if self.node.count_subscribers(cones) < 2),
            *(cones for cones in read.values() if not self.node.count_publishers(cones)),
        ]
        return list(dict.fromkeys(missing))

    def _all_are_known(self, traces: str) -> bool:
        names = self._readers(traces)
        return _UNKNOWN_NODE not in names and len(names) >= _matches(self.publishers[traces])

    def _readers(self, traces: str) -> list[str]:
        return [
            endpoint.node_name for endpoint in self.node.get_subscriptions_info_by_topic(traces)
        ]


def _matches(publisher: Any) -> int:
    return int(publisher.get_subscription_count())
