"""A scenario: world, medium, robots, and what their messages state."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import PrivateAttr, model_validator

from usmap_ros.errors import ConfigurationError, FileError, UsmapError
from usmap_ros.grids import TruthMap
from usmap_ros.io.nav2_map import Nav2Map, load_nav2_map
from usmap_ros.io.yaml_files import read_mapping, validated
from usmap_ros.parameters import ParameterGroup, quantity
from usmap_ros.simulation.build_robots import build_robot, check_is_within
from usmap_ros.simulation.build_world import build_scene, world_bounds
from usmap_ros.simulation.models.conditions import MediumModel, StatedModel
from usmap_ros.simulation.models.robots import RobotModel, check_names_differ
from usmap_ros.simulation.models.world import WorldModel
from usmap_ros.simulation.motion import Bounds
from usmap_ros.simulation.robot import SimulatedRobot, ping_count
from usmap_ros.simulation.scene import Scene
from usmap_ros.simulation.simulator import NANOSECONDS
from usmap_ros.simulation.truth import build_truth_map

#: What a stream of random numbers is for: each has a seed of its own, so that a scenario with
#: another robot or another noise keeps its world.
_WORLD_STREAM, _MOTION_STREAM, _NOISE_STREAM = range(3)


class Scenario(ParameterGroup):
    """Everything that a simulation needs, and all that its result depends on."""

    description: str = quantity("", "What it shows, for people.")
    seed: int = quantity(1, "Of everything random.", ge=0)
    frame_id: str = quantity("map", "World frame of all poses.", min_length=1)
    start_time_s: float = quantity(1_700_000_000.0, "Stamp of the first ping.", "s", ge=0.0, le=4e9)
    duration_s: float = quantity(10.0, "Simulated time.", "s", gt=0.0, le=1e6)
    robot_offset_s: float = quantity(
        0.001, "From one robot's first ping to the next robot's.", "s", ge=0.0, le=10.0
    )
    crosstalk: bool = quantity(
        False, "Whether robots hear the pulses of others that are in the air when they listen."
    )
    world: WorldModel = quantity(WorldModel(), "What stands and moves.")
    medium: MediumModel = quantity(MediumModel(), "Air and floor.")
    robots: list[RobotModel] = quantity(..., "Who maps it.", min_length=1, max_length=1000)
    stated: StatedModel = quantity(StatedModel(), "What messages say that is not true.")

    _source: Path = PrivateAttr(default=Path("scenario"))

    @model_validator(mode="after")
    def _names_differ(self) -> Scenario:
        check_names_differ([robot.name for robot in self.robots])
        return self

    @classmethod
    def load(cls, path: str | Path) -> Scenario:
        """Read a scenario file.

        Raises
        ------
        ConfigurationError
            If there is no such file, or a key in it is unknown or has a value out of range.
        """
        return cls.from_mapping(read_mapping(Path(path)), path)

    @classmethod
    def from_mapping(cls, content: Mapping[str, Any], source: str | Path) -> Scenario:
        """A scenario from the content of a YAML file.

        Parameters
        ----------
        content : mapping
            Keys and values as the YAML has them.
        source : path
            The file: errors name it, and paths in it are relative to its folder.

        Raises
        ------
        ConfigurationError
            Naming the first key that is unknown or has a value out of range.
        """
        scenario = validated(source, cls, dict(content))
        scenario._source = Path(source)
        return scenario

    @property
    def start_ns(self) -> int:
        """Stamp of the first ping, nanoseconds since the epoch."""
        return round(self.start_time_s * NANOSECONDS)

    @property
    def ping_count(self) -> int:
        """Number of pings of all transducers."""
        return sum(
            len(robot.transducers) * ping_count(self.duration_s, 1.0 / robot.ping_rate_hz)
            for robot in self.robots
        )

    @cached_property
    def _plan(self) -> Nav2Map | None:
        if self.world.map is None:
            return None
        return load_nav2_map(self._source.parent / self.world.map.path)

    def scene(self) -> Scene:
        """The world to sound out.

        Raises
        ------
        ConfigurationError
            If something in it has no place.
        MapFileError
            If its map cannot be read.
        """
        with self._errors_name_source():
            return build_scene(self.world, self._plan, self._seed(_WORLD_STREAM))

    def truth_map(self, resolution_m: float = 0.05) -> TruthMap:
        """Cells that hold the surface of something that stands; see `build_truth_map`."""
        scene = self.scene()
        with self._errors_name_source():
            area = world_bounds(self.world, self._plan)
            return build_truth_map(scene, area, self._plan, resolution_m)

    def fleet(self, scene: Scene) -> list[SimulatedRobot]:
        """The robots, ready to move and ping.

        Parameters
        ----------
        scene : Scene
            What they must not run into.

        Raises
        ------
        ConfigurationError
            If a path is blocked or leaves the world, or a transducer cannot exist.
        """
        with self._errors_name_source():
            area = world_bounds(self.world, self._plan)
            return [self._robot(index, scene, area) for index in range(len(self.robots))]

    def _robot(self, index: int, scene: Scene, area: Bounds) -> SimulatedRobot:
        model = self.robots[index]
        try:
            # A world of which nobody says how far it goes has no outside.
            if self.world.area_m is not None or self.world.map is not None:
                check_is_within(model, area)
            return build_robot(
                model,
                scene=scene,
                area=area,
                medium=self.medium,
                stated=self.stated,
                first_ping_s=index * self.robot_offset_s,
                motion_seed=self._seed(_MOTION_STREAM, index),
                noise_seed=self._seed(_NOISE_STREAM, index),
            )
        except UsmapError as error:
            raise UsmapError(f"robots.{index}.{error} (robot {model.name!r})") from error

    def heard_by(self, robot: SimulatedRobot, fleet: list[SimulatedRobot]) -> list[SimulatedRobot]:
        """Those of `fleet` whose pulses a robot hears: all others, if there is crosstalk."""
        return [other for other in fleet if self.crosstalk and other.name != robot.name]

    def _seed(self, *stream: int) -> np.random.SeedSequence:
        return np.random.SeedSequence(self.seed, spawn_key=stream)

    @contextmanager
    def _errors_name_source(self) -> Iterator[None]:
        try:
            yield
        except FileError:
            raise
        except UsmapError as error:
            raise ConfigurationError(self._source, str(error)) from error
