"""Odometry as wheels and a gyro give it: each step nearly right, the sum of them adrift."""

import math
from typing import Literal

import numpy as np

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ParameterGroup, quantity
from usmap_ros.simulation.motion import Motion

#: Steps in which it is summed up; errors are drawn for each.
_STEP_S = 0.02
#: x, y, yaw, share by which wheels are taken too large, bias of the gyro.
_STATES = 5


class OdometryErrors(ParameterGroup):
    """Reported poses are those of wheels and a gyro, which drift; the covariance says how far."""

    slip_m_per_sqrt_m: float = quantity(
        0.02, "Error of the way's length, for the root of each metre.", "m/√m", ge=0.0, le=1.0
    )
    heading_rad_per_sqrt_m: float = quantity(
        0.026, "Error of the heading, for the root of each metre.", "rad/√m", ge=0.0, le=1.0
    )
    turn_rad_per_sqrt_rad: float = quantity(
        0.0,
        "Error of the heading, for the root of each radian that it turns.",
        "rad/√rad",
        ge=0.0,
        le=1.0,
    )
    wheel_radius_std: float = quantity(
        0.01, "Error of the wheels' radius, relative to it; the same all the way.", ge=0.0, le=0.5
    )
    gyro_bias_std_rad_s: float = quantity(
        0.0, "Drift of the heading; the same all the time.", "rad/s", ge=0.0, le=1.0
    )
    start: Literal["known", "unknown"] = quantity(
        "known",
        "Whether the robot knows where it started: poses are in the world's frame. Otherwise they"
        " are in a frame of its own, NAME/odom, where it starts at the origin.",
    )


class WheelOdometry:
    """Where a robot says that it is, who counts the turns of its wheels from a start on.

    Errors are drawn step by step on a clock of its own: whoever asks, and when, gets the same.
    The covariance is that of the errors, propagated to first order with the state (Thrun, Burgard
    & Fox, Probabilistic Robotics, 2005, section 7.4), the constant errors being part of the state.

    Parameters
    ----------
    motion : Motion
        Where the robot's base really is.
    errors : OdometryErrors
        How it is off.
    seed : numpy.random.SeedSequence
        What errors are drawn from.
    start : Pose
        What it says at time 0.
    jumps_s : tuple of float
        When the robot is carried off, of which its wheels know nothing.
    """

    def __init__(
        self,
        motion: Motion,
        errors: OdometryErrors,
        seed: np.random.SeedSequence,
        start: Pose,
        jumps_s: tuple[float, ...] = (),
    ) -> None:
        self._motion, self._errors, self._jumps_s = motion, errors, jumps_s
        self._rng = np.random.default_rng(seed)
        self._scale, self._bias_rad_s = self._rng.standard_normal(2) * (
            errors.wheel_radius_std,
            errors.gyro_bias_std_rad_s,
        )
        self._step = 0
        self._state = np.array([start.position_m[0], start.position_m[1], start.yaw_rad])
        self._covariance = np.zeros((_STATES, _STATES))
        self._covariance[3, 3] = errors.wheel_radius_std**2
        self._covariance[4, 4] = errors.gyro_bias_std_rad_s**2

    def at(self, time_s: float) -> Pose:
        """What it says of the robot's base, with its covariance.

        Parameters
        ----------
        time_s : float
            After the scene's start, and not before the time that was asked for last.
        """
        whole = int(max(time_s, 0.0) / _STEP_S)
        while self._step < whole:
            self._take_step()
        rest = self._increment(self._step * _STEP_S, max(time_s, 0.0))
        x_m, y_m, yaw_rad = _moved(self._state, rest)
        return Pose.planar(x_m, y_m, yaw_rad, planar_covariance=self._covariance[:3, :3].copy())

    def _increment(self, from_s: float, to_s: float) -> FloatArray:
        """True change of x, y and yaw as seen from the robot; nothing while it is carried."""
        if any(from_s < jump_s <= to_s for jump_s in self._jumps_s):
            return np.zeros(3)
        change = self._motion.pose(from_s).inverse().compose(self._motion.pose(to_s))
        return np.array([change.position_m[0], change.position_m[1], change.yaw_rad])

    def _take_step(self) -> None:
        # One's end is the next one's start to the last bit: headings may change at once.
        true = self._increment(self._step * _STEP_S, (self._step + 1) * _STEP_S)
        errors, way_m = self._errors, math.hypot(true[0], true[1])
        slip_m = errors.slip_m_per_sqrt_m * math.sqrt(way_m)
        turn_rad = math.hypot(
            errors.heading_rad_per_sqrt_m * math.sqrt(way_m),
            errors.turn_rad_per_sqrt_rad * math.sqrt(abs(true[2])),
        )
        slipped, turned = self._rng.standard_normal(2) * (slip_m, turn_rad)
        along = true[:2] / way_m if way_m > 0.0 else np.zeros(2)
        told = true.copy()
        told[:2] += true[:2] * self._scale + along * slipped
        told[2] += self._bias_rad_s * _STEP_S + turned
        self._propagate(true, along, slip_m, turn_rad)
        self._state = np.array(_moved(self._state, told))
        self._step += 1

    def _propagate(
        self, true: FloatArray, along: FloatArray, slip_m: float, turn_rad: float
    ) -> None:
        """Covariance after a step."""
        cosine, sine = math.cos(self._state[2]), math.sin(self._state[2])
        turn = np.array([[cosine, -sine], [sine, cosine]])
        way_x_m, way_y_m = turn @ true[:2]
        forward = np.eye(_STATES)
        forward[0, 2], forward[1, 2] = -way_y_m, way_x_m
        forward[:2, 3] = way_x_m, way_y_m
        forward[2, 4] = _STEP_S
        self._covariance = forward @ self._covariance @ forward.T
        direction = turn @ along
        self._covariance[:2, :2] += slip_m**2 * np.outer(direction, direction)
        self._covariance[2, 2] += turn_rad**2


def _moved(state: FloatArray, change: FloatArray) -> tuple[float, float, float]:
    """x, y and yaw after a change that is given as seen from there."""
    cosine, sine = math.cos(state[2]), math.sin(state[2])
    return (
        float(state[0] + cosine * change[0] - sine * change[1]),
        float(state[1] + sine * change[0] + cosine * change[1]),
        float(state[2] + change[2]),
    )
