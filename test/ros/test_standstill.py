"""Whether simulated time stands still is told by the clock, and by who publishes it."""

from typing import Any

from rclpy.parameter import Parameter
from rclpy.time import Time

from usmap_ros.nodes.plumbing.ros_types import interface_class
from usmap_ros.nodes.plumbing.standstill import Standstill


def test_simulated_time_stands_still_until_it_moves_or_its_clock_is_gone(live: Any) -> None:
    live.peer.set_parameters([Parameter("use_sim_time", value=True)])
    publisher = live.publisher("rosgraph_msgs/msg/Clock", "/clock")
    clock, is_standing = live.peer.get_clock(), Standstill(live.peer)

    def tell(time_ns: int) -> None:
        publisher.publish(
            interface_class("rosgraph_msgs/msg/Clock")(clock=Time(nanoseconds=time_ns).to_msg())
        )
        live.until(lambda: clock.now().nanoseconds == time_ns)

    tell(5)
    assert not is_standing()
    assert is_standing()
    tell(7)
    assert not is_standing()
    tell(7)
    assert is_standing()
    live.peer.destroy_publisher(publisher)
    live.until(lambda: not is_standing())


def test_real_time_never_stands_still(live: Any) -> None:
    is_standing = Standstill(live.peer)
    assert not is_standing()
    assert not is_standing()
