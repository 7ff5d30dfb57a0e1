"""The world section of a scenario: what stands where, and what it is made of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import model_validator

from usmap_ros.parameters import ParameterGroup, quantity
from usmap_ros.simulation.polyline import Coordinate, Point
from usmap_ros.simulation.scene import MovingDisc
from usmap_ros.simulation.surfaces import Surface


class PointModel(ParameterGroup):
    """A thin pole."""

    x_m: Coordinate = quantity(..., "Position.", "m")
    y_m: Coordinate = quantity(..., "Position.", "m")
    reflectivity: float = quantity(1.0, "As a point target.", gt=0.0, le=100.0)


class CylinderModel(PointModel):
    """A round pillar: hides what is behind it."""

    radius_m: float = quantity(..., "Radius.", "m", gt=0.0, le=100.0)


class BallModel(ParameterGroup):
    """A ball at a height of its own: off the plane of the transducers, or in it."""

    x_m: Coordinate = quantity(..., "Position.", "m")
    y_m: Coordinate = quantity(..., "Position.", "m")
    z_m: Coordinate = quantity(..., "Height of its centre in the world frame.", "m")
    radius_m: float = quantity(0.0, "Radius; 0: a point.", "m", ge=0.0, le=10.0)
    reflectivity: float | None = quantity(
        None,
        "As a point target; None: half the radius, as of a large rigid ball.",
        gt=0.0,
        le=100.0,
    )

    @model_validator(mode="after")
    def _returns_something(self) -> BallModel:
        if self.reflectivity is None and self.radius_m == 0.0:
            raise ValueError("reflectivity: is needed where radius_m is 0")
        return self


class FacetModel(ParameterGroup):
    """A small mirror that faces somewhere: what it returns depends on the angle."""

    x_m: Coordinate = quantity(..., "Position.", "m")
    y_m: Coordinate = quantity(..., "Position.", "m")
    z_m: Coordinate | None = quantity(
        None, "Height in the world frame; None: that of whoever listens.", "m"
    )
    normal_rad: float = quantity(
        ..., "Direction that it faces, from the x axis to the left.", "rad", ge=-7.0, le=7.0
    )
    elevation_rad: float = quantity(
        0.0, "How far it faces upwards.", "rad", ge=-0.5 * np.pi, le=0.5 * np.pi
    )
    lobe_rad: float = quantity(
        0.2,
        "Angle off the normal at which exp(-1/2) of the amplitude is left.",
        "rad",
        gt=0.0,
        le=np.pi,
    )
    reflectivity: float = quantity(1.0, "As a point target, from straight ahead.", gt=0.0, le=100.0)


class RandomPolesModel(ParameterGroup):
    """Poles at random places, with log-normal reflectivities."""

    count: int = quantity(..., "How many.", ge=1, le=10_000)
    separation_m: float = quantity(
        0.3, "Least distance between the centres of two.", "m", ge=0.0, le=1e3
    )
    radius_m: float = quantity(0.0, "Radius; 0: points, which hide nothing.", "m", ge=0.0, le=10.0)
    median_reflectivity: float = quantity(1.0, "Median, as point targets.", gt=0.0, le=100.0)
    reflectivity_spread: float = quantity(
        0.35, "Standard deviation of the reflectivity's natural logarithm.", ge=0.0, le=3.0
    )


class WallModel(ParameterGroup):
    """Straight walls from corner to corner, seen from both sides."""

    corners_m: list[Point] = quantity(..., "x, y of each corner.", "m", min_length=2)
    closed: bool = quantity(False, "Whether a last wall leads back to the first corner.")
    surface: Surface | None = quantity(None, "None: the world's surface.")

    @model_validator(mode="after")
    def _corners_differ(self) -> WallModel:
        ends = [*self.corners_m[1:], self.corners_m[0] if self.closed else None]
        for corner, end in zip(self.corners_m, ends, strict=True):
            if corner == end:
                raise ValueError(f"corners_m: the wall at {corner} has no length")
        return self


class MapModel(ParameterGroup):
    """An occupancy map: its occupied cells are walls."""

    path: Path = quantity(..., "nav2 map YAML; relative to the scenario file.")
    surface: Surface | None = quantity(None, "None: the world's surface.")


class WorldModel(ParameterGroup):
    """What stands and moves in the world."""

    area_m: tuple[Coordinate, Coordinate, Coordinate, Coordinate] | None = quantity(
        None,
        "Lowest and highest x, lowest and highest y: where robots wander, random poles stand and"
        " the truth map reaches. None: the bounding box of all that stands.",
        "m",
    )
    points: list[PointModel] = quantity([], "Thin poles.")
    cylinders: list[CylinderModel] = quantity([], "Round pillars.")
    random_poles: RandomPolesModel | None = quantity(None, "Poles at random places.")
    balls: list[BallModel] = quantity([], "Balls at heights of their own.")
    facets: list[FacetModel] = quantity([], "Small mirrors that face somewhere.")
    walls: list[WallModel] = quantity([], "Straight walls.")
    wall_paths: bool = quantity(
        False,
        "Whether sound reaches poles, pillars, balls and facets by way of a wall too, with one"
        " reflection there and one back.",
    )
    wall_bounces: int = quantity(
        1,
        "Most walls by which sound is returned in turn: 2 for inner corners, 3 for the flutter"
        " between walls that face each other.",
        ge=1,
        le=3,
    )
    map: MapModel | None = quantity(None, "A nav2 map whose occupied cells are walls.")
    moving: list[MovingDisc] = quantity([], "What moves; not part of the truth map.")
    surface: Surface = quantity(Surface(), "Of all walls that state none.")

    @model_validator(mode="after")
    def _area_is_one(self) -> WorldModel:
        if self.area_m is not None:
            x_min, x_max, y_min, y_max = self.area_m
            if not (x_min < x_max and y_min < y_max):
                raise ValueError("area_m: the lowest must be below the highest, in x and in y")
        return self
