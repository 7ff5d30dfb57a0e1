"""The inbox that suits the rclpy there is."""

from collections.abc import Callable

from rclpy.node import Node

from usmap_ros.nodes.plumbing.inbox import Inbox


def open_inbox(node: Node, after: Callable[[], float | None] = lambda: None) -> Inbox:
    """The inbox that takes least of the processor, of those that this rclpy has what it takes for.

    Parameters
    ----------
    node, after
        As of `usmap_ros.nodes.plumbing.inbox.Inbox`.
    """
    try:
        from usmap_ros.nodes.plumbing.wait_set_inbox import WaitSetInbox

        return WaitSetInbox(node, after)
    except (ImportError, AttributeError, TypeError) as error:
        node.get_logger().warning(
            f"rclpy's executor takes the messages, which costs more of the processor: {error}"
        )
    return Inbox(node, after)
