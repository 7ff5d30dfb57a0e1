"""Whether simulated time stands still."""

from typing import Any

from usmap_ros.live.interfaces import CLOCK


class Standstill:
    """Whether a node's simulated time has stood still since it was last asked.

    A replay lets it stand while it waits for a slow reader, a simulator while it is paused.  Real
    time never does, nor that of a clock that nobody publishes any more.

    Parameters
    ----------
    node : Node
        Whose clock it is.
    """

    def __init__(self, node: Any) -> None:
        self._node, self._before_ns = node, -1

    def __call__(self) -> bool:
        """Look at the clock."""
        clock = self._node.get_clock()
        before_ns, self._before_ns = self._before_ns, clock.now().nanoseconds
        stands = clock.ros_time_is_active and self._before_ns == before_ns
        return stands and self._node.count_publishers(CLOCK.name) > 0
