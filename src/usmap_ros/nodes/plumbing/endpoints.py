"""Publishers, subscriptions and services from their declarations in `interfaces`."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from usmap_ros.live.interfaces import Qos, ServiceInterface, Topic
from usmap_ros.nodes.plumbing.ros_types import interface_class

#: How much deeper the queue of a subscription is than that of a publisher.
QUEUE_DEPTH_FACTOR = 10


def qos_profile(qos: Qos) -> QoSProfile:
    """Quality of service as rclpy takes it."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=qos.depth,
        reliability=(
            ReliabilityPolicy.RELIABLE if qos.is_reliable else ReliabilityPolicy.BEST_EFFORT
        ),
        durability=(
            DurabilityPolicy.TRANSIENT_LOCAL if qos.is_latched else DurabilityPolicy.VOLATILE
        ),
    )


def within(namespace: str, topic: Topic) -> str:
    """Name of a topic in a namespace below the node's own; none if it is empty."""
    return f"{namespace}/{topic.name}" if namespace else topic.name


def advertise(node: Node, topic: Topic, name: str | None = None) -> Any:
    """Publisher of a topic, under another name if one is given."""
    return node.create_publisher(
        interface_class(topic.message_type), name or topic.name, qos_profile(topic.qos)
    )


def advertise_managed(node: Any, topic: Topic) -> Any:
    """Publisher that is silent unless its lifecycle node is active."""
    return node.create_lifecycle_publisher(
        interface_class(topic.message_type), topic.name, qos_profile(topic.qos)
    )


def subscribe(
    node: Node,
    topic: Topic,
    callback: Callable[[Any], None],
    name: str | None = None,
    raw: bool = False,
    group: CallbackGroup | None = None,
) -> Any:
    """Subscription to a topic, under another name if one is given; `raw`: as bytes.

    Its queue is deeper than the publisher's: what comes while the node is busy is lost in silence
    once a queue is full, reliable or not.
    """
    qos = replace(topic.qos, depth=QUEUE_DEPTH_FACTOR * topic.qos.depth)
    return node.create_subscription(
        interface_class(topic.message_type),
        name or topic.name,
        callback,
        qos_profile(qos),
        callback_group=group,
        raw=raw,
    )


def serve(node: Node, service: ServiceInterface, callback: Callable[[Any, Any], Any]) -> Any:
    """Offer a service."""
    return node.create_service(interface_class(service.service_type), service.name, callback)


def every(node: Node, period_s: float, callback: Callable[[], None]) -> Any:
    """Timer in real time, which goes on while simulated time stands still."""
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(period_s, callback, clock=clock)
