"""What all nodes that are there say of themselves."""

import time
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor

from usmap_ros.live.health import Level, Report
from usmap_ros.live.interfaces import DIAGNOSTICS
from usmap_ros.nodes.plumbing.endpoints import subscribe
from usmap_ros.nodes.plumbing.run import prepare_environment


def collect_reports(wait_s: float) -> dict[str, Report]:
    """Latest report of every node that speaks on /diagnostics within `wait_s`, by its name."""
    prepare_environment()
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node("usmap_status", context=context)
    reports: dict[str, Report] = {}

    def receive(message: Any) -> None:
        reports.update((status.name, report_of(status)) for status in message.status)

    subscribe(node, DIAGNOSTICS, receive)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    end_s = time.monotonic() + wait_s
    try:
        while (left_s := end_s - time.monotonic()) > 0.0:
            executor.spin_once(timeout_sec=left_s)
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    return dict(sorted(reports.items()))


def report_of(status: Any) -> Report:
    """Undo what a node makes of its report; a level that is none of ours is an error."""
    number = status.level[0]
    level = Level(number) if number in list(Level) else Level.ERROR
    return Report(level, status.message, {value.key: value.value for value in status.values})
