"""How robots move: along waypoints, or at random, and never through anything that stands."""

from bisect import bisect_right
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from usmap_ros.bounds import WALK_STEP
from usmap_ros.errors import UsmapError
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ParameterGroup, quantity
from usmap_ros.simulation.polyline import Coordinate, Point, Polyline
from usmap_ros.simulation.scene import Scene

#: Lowest and highest x, then y.
Bounds = tuple[float, float, float, float]

#: How often a random walk is redrawn where something is in the way, before the robot waits.
_STEP_ATTEMPTS = 20
#: How often a random start is redrawn.
_START_ATTEMPTS = 10_000


class BlockedPathError(UsmapError):
    """A path that a robot cannot take."""


class Motion(Protocol):
    """Where a robot is, as a function of time."""

    def pose(self, time_s: float) -> Pose:
        """True pose of the robot's base at a time after the scene's start."""
        ...


@dataclass(frozen=True)
class DelayedMotion:
    """A robot that stands where it starts, and moves later."""

    #: How it moves then.
    motion: Motion
    #: How long it stands.
    starts_after_s: float

    def pose(self, time_s: float) -> Pose:
        """True pose of the robot's base at a time after the scene's start."""
        return self.motion.pose(max(time_s - self.starts_after_s, 0.0))


class CarriedOff:
    """A robot that is taken to another place, once or several times, and goes on from there.

    Parameters
    ----------
    first : Motion
        Until it is taken away.
    then : list of (from_s, Motion)
        From when on it moves how, in the order of time; motions begin at their own time 0.
    """

    def __init__(self, first: Motion, then: list[tuple[float, Motion]]) -> None:
        self._parts = [(0.0, first), *then]
        self._starts_s = [from_s for from_s, _ in self._parts[1:]]

    def pose(self, time_s: float) -> Pose:
        """True pose of the robot's base at a time after the scene's start."""
        from_s, motion = self._parts[bisect_right(self._starts_s, time_s)]
        return motion.pose(time_s - from_s)


class WaypointModel(ParameterGroup):
    """A robot that follows waypoints."""

    kind: Literal["waypoints"] = quantity(..., "Kind of motion.")
    waypoints_m: list[Point] = quantity(..., "x, y of each waypoint.", "m", min_length=1)
    loop: bool = quantity(True, "Whether it goes round; otherwise it stays at the end.")
    speed_m_s: float = quantity(0.5, "Speed.", "m/s", ge=0.0, le=100.0)
    heading_rad: float = quantity(
        0.0, "Added to the direction of the path.", "rad", ge=-2.0 * np.pi, le=2.0 * np.pi
    )
    spin_rad_s: float = quantity(
        0.0, "Rate at which it turns as it goes.", "rad/s", ge=-100.0, le=100.0
    )
    clearance_m: float = quantity(
        0.2, "Room that it needs around its centre.", "m", ge=0.0, le=100.0
    )


class RandomWalkModel(ParameterGroup):
    """A robot that wanders."""

    kind: Literal["random_walk"] = quantity("random_walk", "Kind of motion.")
    start: tuple[Coordinate, Coordinate, Coordinate] | None = quantity(
        None, "x (m), y (m) and yaw (rad) at the start; None: at random where there is room."
    )
    speed_m_s: float = quantity(1.2, "Speed.", "m/s", ge=0.0, le=100.0)
    turn_std_rad: float = quantity(
        0.4, "Standard deviation of the turn from step to step.", "rad", ge=0.0, le=np.pi
    )
    step_s: float = quantity(
        0.1, "Duration of a step.", "s", ge=WALK_STEP.least, le=WALK_STEP.greatest
    )
    clearance_m: float = quantity(
        0.2, "Room that it needs around its centre.", "m", ge=0.0, le=100.0
    )


class WaypointMotion:
    """A robot that follows waypoints at constant speed and looks where it goes.

    Parameters
    ----------
    model : WaypointModel
        The waypoints, and how it follows them.
    scene : Scene
        What it must not run into.

    Raises
    ------
    BlockedPathError
        If a leg of the path comes closer than its clearance to something.
    """

    def __init__(self, model: WaypointModel, scene: Scene) -> None:
        self._model = model
        self._path = Polyline(np.array(model.waypoints_m), model.loop)
        corners = self._path.corners_m
        if not scene.has_room(corners[0], model.clearance_m):
            raise BlockedPathError(
                f"there is no room at the start ({corners[0][0]:g}, {corners[0][1]:g})"
            )
        # A single waypoint makes one leg without length.
        for leg, (start, end) in enumerate(zip(corners, [*corners[1:], corners[-1]], strict=True)):
            room = scene.clearance_m(start, end)
            if room < model.clearance_m:
                raise BlockedPathError(
                    f"the leg from waypoint {leg} at ({start[0]:g}, {start[1]:g})"
                    f" leaves {max(room, 0.0):.2f} m of room, less than {model.clearance_m:g} m"
                )

    def pose(self, time_s: float) -> Pose:
        """True pose of the robot's base at a time after the scene's start."""
        position, direction = self._path.at(self._model.speed_m_s * time_s)
        heading = direction + self._model.heading_rad + self._model.spin_rad_s * time_s
        return Pose.planar(position[0], position[1], heading)


class RandomWalk:
    """A robot that wanders: short straight steps, each in a slightly different direction.

    The walk is drawn as far as it is asked for, and the same however it is asked.

    Parameters
    ----------
    model : RandomWalkModel
        How fast it goes, how it turns, and the room that it needs.
    scene : Scene
        What it must not run into.
    bounds : (x_min, x_max, y_min, y_max)
        It stays inside.
    start : Pose or None
        None: drawn at random where there is room.
    rng : numpy.random.Generator
        For the start and the steps; it belongs to the walk from now on.

    Raises
    ------
    BlockedPathError
        If there is no room at the start.
    """

    def __init__(
        self,
        model: RandomWalkModel,
        scene: Scene,
        bounds: Bounds,
        start: Pose | None,
        rng: np.random.Generator,
    ) -> None:
        self._model, self._scene, self._bounds, self._rng = model, scene, bounds, rng
        first = self._random_start() if start is None else start
        self._start_heading_rad = first.yaw_rad
        # A step leads from one position to the next; there is one heading for each step.
        self._positions = [first.position_m[:2]]
        self._headings: list[float] = []
        if not self._has_room(self._positions[0]):
            x, y = self._positions[0]
            raise BlockedPathError(f"there is no room at the start ({x:g}, {y:g})")

    def pose(self, time_s: float) -> Pose:
        """True pose of the robot's base at a time after the scene's start."""
        steps = max(time_s, 0.0) / self._model.step_s
        step = int(steps)
        while len(self._headings) <= step:
            self._take_step()
        fraction = steps - step
        position = (1.0 - fraction) * self._positions[step] + fraction * self._positions[step + 1]
        return Pose.planar(position[0], position[1], self._headings[step])

    def _take_step(self) -> None:
        here, heading = self._positions[-1], self._start_heading_rad
        if self._headings:
            heading = self._headings[-1] + self._model.turn_std_rad * self._rng.standard_normal()
        step_m = self._model.speed_m_s * self._model.step_s
        for _ in range(_STEP_ATTEMPTS):
            there = here + step_m * np.array([np.cos(heading), np.sin(heading)])
            if self._is_passable(here, there):
                break
            heading = self._rng.uniform(-np.pi, np.pi)
        else:
            there = here
        self._positions.append(there)
        self._headings.append(heading)

    def _random_start(self) -> Pose:
        x_min, x_max, y_min, y_max = self._bounds
        for _ in range(_START_ATTEMPTS):
            position = self._rng.uniform([x_min, y_min], [x_max, y_max])
            if self._has_room(position):
                return Pose.planar(position[0], position[1], self._rng.uniform(-np.pi, np.pi))
        raise BlockedPathError("there is no room for a start anywhere in the area")

    def _has_room(self, position_m: FloatArray) -> bool:
        return self._is_inside(position_m) and self._scene.has_room(
            position_m, self._model.clearance_m
        )

    def _is_passable(self, start_m: FloatArray, end_m: FloatArray) -> bool:
        if not self._is_inside(end_m):
            return False
        return self._scene.clearance_m(start_m, end_m) >= self._model.clearance_m

    def _is_inside(self, position_m: FloatArray) -> bool:
        x_min, x_max, y_min, y_max = self._bounds
        return bool(x_min <= position_m[0] <= x_max and y_min <= position_m[1] <= y_max)
