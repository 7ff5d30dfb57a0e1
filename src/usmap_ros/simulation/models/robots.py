"""The robots section of a scenario: how they move, and what they carry."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from usmap_ros.parameters import ParameterGroup, quantity
from usmap_ros.simulation.models.transducers import TransducerModel
from usmap_ros.simulation.motion import RandomWalkModel, WaypointModel
from usmap_ros.simulation.polyline import Coordinate
from usmap_ros.simulation.wheel_odometry import OdometryErrors


class PoseErrorModel(ParameterGroup):
    """Error of reported poses; the covariance in the message is that of the error."""

    position_std_m: float = quantity(0.0, "Of x and of y.", "m", ge=0.0, le=100.0)
    yaw_std_rad: float = quantity(0.0, "Of the heading.", "rad", ge=0.0, le=np.pi)
    wander_s: float = quantity(
        0.0,
        "Time in which the memory of an error falls to 1/e: the error is a bias that wanders;"
        " 0: every ping has one of its own.",
        "s",
        ge=0.0,
        le=1e6,
    )
    late_s: float = quantity(
        0.0,
        "How long before its stamp a pose was true, of which the covariance says nothing.",
        "s",
        ge=0.0,
        le=10.0,
    )


class CarriedOffModel(ParameterGroup):
    """Somebody takes the robot to another place, of which its odometry knows nothing."""

    at_s: float = quantity(..., "When, after the start.", "s", gt=0.0, le=1e6)
    to: tuple[Coordinate, Coordinate, Coordinate] = quantity(
        ..., "x (m), y (m) and yaw (rad) where it goes on."
    )


class RobotModel(ParameterGroup):
    """One robot."""

    name: str = quantity(..., "First part of its topics and frames.", pattern=r"^[A-Za-z]\w*$")
    motion: Annotated[WaypointModel | RandomWalkModel, Field(discriminator="kind")] = quantity(
        RandomWalkModel(), "How it moves."
    )
    transducers: list[TransducerModel] = quantity(
        [TransducerModel()], "What it carries.", min_length=1, max_length=64
    )
    ping_rate_hz: float = quantity(10.0, "Of each transducer.", "Hz", gt=0.0, le=1000.0)
    simultaneous: bool = quantity(
        False,
        "Whether its transducers ping at once and hear one another's pulses, which must differ;"
        " otherwise they take turns.",
    )
    starts_after_s: float = quantity(
        0.0, "How long it stands where it starts, and pings, before it moves.", "s", ge=0.0, le=1e6
    )
    moves_during_ping: bool = quantity(
        False, "Whether it goes on moving while it listens; otherwise a ping takes no time."
    )
    pose_error: PoseErrorModel = quantity(PoseErrorModel(), "Error of reported poses.")
    odometry: OdometryErrors | None = quantity(
        None, "Poses drift as those of wheels do; None: they are absolute. Not beside pose_error."
    )
    carried_off: list[CarriedOffModel] = quantity(
        [],
        "When it is taken elsewhere, in the order of time; only robots that wander.",
        max_length=100,
    )

    @model_validator(mode="after")
    def _poses_are_off_in_one_way(self) -> RobotModel:
        error = self.pose_error
        if self.odometry is not None and (error.position_std_m or error.yaw_std_rad):
            raise ValueError("odometry: does not go with pose_error")
        return self

    @model_validator(mode="after")
    def _is_carried_in_order(self) -> RobotModel:
        times_s = [move.at_s for move in self.carried_off]
        if times_s and not isinstance(self.motion, RandomWalkModel):
            raise ValueError("carried_off: only a robot of kind random_walk goes on from anywhere")
        if any(later <= earlier for earlier, later in pairwise(times_s)):
            raise ValueError("carried_off: at_s does not ascend")
        return self

    @model_validator(mode="after")
    def _names_differ(self) -> RobotModel:
        check_names_differ([transducer.name for transducer in self.transducers])
        return self

    @model_validator(mode="after")
    def _pulses_can_be_told_apart(self) -> RobotModel:
        pulses = [one.pulse.build() for one in self.transducers if one.emits]
        if not pulses:
            raise ValueError("transducers: none of them emits")
        if not self.simultaneous and len(pulses) < len(self.transducers):
            raise ValueError("simultaneous: must be true where a transducer only listens")
        if self.simultaneous and len(set(pulses)) < len(pulses):
            raise ValueError("transducers: two that ping at once send the same pulse")
        return self


def check_names_differ(names: list[str]) -> None:
    """Raise `ValueError` if a name stands twice."""
    repeated = next((name for name in names if names.count(name) > 1), None)
    if repeated is not None:
        raise ValueError(f"two have the name {repeated!r}")
