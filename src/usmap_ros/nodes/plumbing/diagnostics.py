"""What a node says of itself on /diagnostics."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from usmap_ros.live.health import Health
from usmap_ros.live.interfaces import DIAGNOSTICS
from usmap_ros.nodes.plumbing.endpoints import advertise, every


class NodeHealth(Health):
    """The health of a node, published at an interval.

    Parameters
    ----------
    node : Node
        Whose health it is.
    period_s : float
        From one message to the next.
    counted : sequence of str
        What is counted; all of it is reported, from the start.
    """

    def __init__(self, node: Node, period_s: float, counted: tuple[str, ...]) -> None:
        super().__init__(counted, node.get_logger().warning)
        self._node = node
        self._publisher = advertise(node, DIAGNOSTICS)
        every(node, period_s, self._publish)

    def _publish(self) -> None:
        report = self.report()
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = [
            DiagnosticStatus(
                level=bytes([report.level]),
                name=self._node.get_fully_qualified_name(),
                message=report.message,
                hardware_id=self._node.get_namespace().strip("/"),
                values=[KeyValue(key=key, value=value) for key, value in report.facts.items()],
            )
        ]
        self._publisher.publish(message)
