"""Where a simulated robot is: on its own path, or where another program moves it."""

from dataclasses import dataclass
from typing import Any, Protocol

from rclpy.node import Node

from usmap_ros.errors import MalformedMessageError, UsmapError
from usmap_ros.io.conversions import odometry_from_message
from usmap_ros.live.health import Health
from usmap_ros.live.interfaces import ODOM
from usmap_ros.nodes.plumbing.endpoints import subscribe
from usmap_ros.nodes.plumbing.frames import NoTransformError, Transforms
from usmap_ros.numerics.geometry import Pose
from usmap_ros.simulation.motion import Motion

#: Of a path, what is drawn at once, s: some 50 ms of work.
_STRETCH_S = 50.0


class NoPoseError(UsmapError):
    """A pose that is not known, or not any more."""


class PoseSource(Protocol):
    """Where a robot's base is."""

    def sample(self, now_ns: int, elapsed_s: float) -> tuple[Pose, int]:
        """True pose of the base, and its stamp.

        Parameters
        ----------
        now_ns : int
            The clock's reading.
        elapsed_s : float
            Time since the scenario began.

        Raises
        ------
        NoPoseError
            If it is not known.
        """
        ...


class PathPose:
    """A robot on the path that its scenario gives it.

    Parameters
    ----------
    motion : Motion
        Pose of the robot's base by the time since the scenario began.
    """

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self._drawn_s = 0.0

    def sample(self, now_ns: int, elapsed_s: float) -> tuple[Pose, int]:
        """Pose at this time; at the start before it."""
        # A random walk is drawn step by step.  One that began hours ago is drawn a part at a
        # time, so that the node goes on answering meanwhile.
        if elapsed_s > self._drawn_s + _STRETCH_S:
            self._drawn_s += _STRETCH_S
            self._motion.pose(self._drawn_s)
            raise NoPoseError(
                f"the robot's path is drawn up to {self._drawn_s:.0f} of {elapsed_s:.0f} s"
            )
        self._drawn_s = max(self._drawn_s, elapsed_s)
        return self._motion.pose(max(0.0, elapsed_s)), now_ns


class OdometryPose:
    """A robot that another program moves, which says so on ``odom``.

    Parameters
    ----------
    node : Node
        The node that subscribes to ``odom``.
    health : Health
        Counts what is no odometry.
    timeout_s : float
        Age from which on a pose is too old.
    """

    def __init__(self, node: Node, health: Health, timeout_s: float) -> None:
        self._health = health
        self._timeout_s = timeout_s
        self._latest: tuple[Pose, int] | None = None
        subscribe(node, ODOM, self._receive)

    def sample(self, now_ns: int, elapsed_s: float) -> tuple[Pose, int]:
        """Latest pose."""
        if self._latest is None:
            raise NoPoseError("no odometry has come yet")
        return _young_enough(self._latest, now_ns, self._timeout_s)

    def _receive(self, message: Any) -> None:
        self._health.count("received")
        try:
            self._latest = odometry_from_message(message)
        except MalformedMessageError as error:
            self._health.problem("malformed", f"odom: {error}")


@dataclass(frozen=True)
class TransformPose:
    """A robot that TF knows."""

    #: The node's buffer of TF.
    transforms: Transforms
    #: The robot's frame, and that of the scenario.
    base_frame: str
    world: str
    #: Age from which on a pose is too old.
    timeout_s: float

    def sample(self, now_ns: int, elapsed_s: float) -> tuple[Pose, int]:
        """Latest pose."""
        try:
            latest = self.transforms.pose_of(self.base_frame, self.world)
        except (NoTransformError, MalformedMessageError) as error:
            raise NoPoseError(f"{self.base_frame} in {self.world}: {error}") from error
        return _young_enough(latest, now_ns, self.timeout_s)


def _young_enough(latest: tuple[Pose, int], now_ns: int, timeout_s: float) -> tuple[Pose, int]:
    age_s = (now_ns - latest[1]) / 1e9
    if abs(age_s) > timeout_s:
        raise NoPoseError(
            f"the latest pose is {age_s:.3g} s old; with simulated time, use_sim_time must be true"
        )
    return latest
