"""One ping in bins of range, as fusion keeps it, and what of it is not of each bin."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: What a range bin holds: nothing that could be judged, an echo, or silence up to a limit.
UNJUDGED, ECHO, SILENCE = 0, 1, 2

#: Number of a range bin that is beyond all.
NEVER = 1 << 30

#: Range bins along the side of a cell, and the finest bin: echoes are no better separated.
BINS_PER_CELL = 4
FINEST_BIN_M = 0.0125
#: Entries of the table of power gains.
GAIN_STEPS = 512
#: An uncertain heading widens the cone by so many of its standard deviations, and is averaged over
#: at so many places, in steps of so much.
WIDENING_STDS, HEADINGS, HEADING_STEP_RAD = 2.0, 15, 1e-3
#: The receiver's noise lies this far below the detection limit, in power: a factor of 4 in
#: amplitude, what `false_alarms_per_ping` comes to.
NOISE_BELOW_LIMIT = 1.0 / 16.0
#: A limit above this amplitude is no limit: the bin was not listened to.  Messages know no higher
#: limit than 10^(27.5 / 20).
DEAF_AMPLITUDE = 23.0
#: Power of the noise that nothing falls below.
LEAST_NOISE = 1e-12


class PingBins(NamedTuple):
    """A ping in the window, in the form that compiled functions take."""

    #: Of the transducer.
    x_m: float
    y_m: float
    #: Beam axis, a unit vector.
    axis_x: float
    axis_y: float
    axis_z: float
    #: Of what stands on the map above the transducer.
    rise_m: float
    #: Of the axis on the plane.
    heading_rad: float
    #: Of the cone, as wide as the uncertainty of its heading makes it.
    half_angle_rad: float
    cos_half_angle: float
    #: Where echoes are looked for.
    least_range_m: float
    greatest_range_m: float
    #: Share of the power lost there and back, as a rate of the range: exp(−rate · r).
    absorption_per_m: float
    #: Of where things are seen, from the pose's covariance and what nobody states.
    range_std_m: float
    #: Width of a range bin.
    bin_m: float
    #: Power of the receiver's noise in a bin.
    noise: float
    #: (GAIN_STEPS + 1,) float32 array: two-way power gain over (1 − cos θ) / (1 − cos half angle):
    #: its mean over the headings that the pose's covariance allows.
    power_gain: NDArray[np.float32]
    #: (bins,) uint8 array: UNJUDGED, ECHO or SILENCE.
    kind: NDArray[np.uint8]
    #: (bins,) float32 array: of the echoes in each bin.
    power: NDArray[np.float32]
    #: (bins + 1,) int32 array: first range bin from each on that has an echo; `NEVER` if there is
    #: none.
    next_echo: NDArray[np.int32]
    #: (bins,) float32 array: power below which an echo may have gone unreported.
    limit: NDArray[np.float32]
    #: (bins,) float32 arrays: measured direction of the echo in each bin, rad off the heading, and
    #: 1 / (2 σ²) of it; 0 where it is not known.
    bearing: NDArray[np.float32]
    bearing_weight: NDArray[np.float32]


class PingNumbers(NamedTuple):
    """Of one ping what is not of each range bin."""

    #: Its numbers, in the order of `PingBins`; of the noise nothing is known yet.
    numbers: tuple[float, ...]
    #: Standard deviation of bearings by the uncertainty of its pose.
    bearing_std_rad: float
    #: As in `PingBins`.
    power_gain: NDArray[np.float32]


def ping_numbers(cone: EchoCone, parameters: MappingParameters) -> PingNumbers:
    """What is a number of its own of a ping, and its beam.

    Parameters
    ----------
    cone : EchoCone
        A valid cone.
    parameters : MappingParameters
        Cell size and the error of range that nobody states.
    """
    transducer, beam = cone.transducer, cone.transducer.beam
    axis_x, axis_y, axis_z = cone.pose.rotation[:, 0].tolist()
    x_m, y_m, _ = cone.pose.position_m.tolist()
    position_variance, bearing_std = _uncertainty(cone)
    half_angle = min(float(beam.half_angle_rad) + WIDENING_STDS * bearing_std, math.pi)
    numbers = (
        float(x_m), float(y_m), axis_x, axis_y, axis_z, float(cone.object_rise_m),
        math.atan2(axis_y, axis_x), half_angle, math.cos(half_angle),
        float(transducer.min_range_m), float(transducer.max_range_m),
        4.0 * float(cone.attenuation_db_m) * math.log(10.0) / 20.0,
        math.hypot(parameters.range_error_m, math.sqrt(position_variance)),
        max(FINEST_BIN_M, parameters.resolution_m / BINS_PER_CELL), LEAST_NOISE,
    )  # fmt: skip
    gain = _power_gain(beam.angles_rad.tobytes(), beam.gains.tobytes(), bearing_std, half_angle)
    return PingNumbers(numbers, bearing_std, gain)


def _uncertainty(cone: EchoCone) -> tuple[float, float]:
    """Variance of the position along any direction, and standard deviation of bearings.

    Errors of successive poses are a bias that wanders: they do not average out over a few pings,
    and each ping is taken to be as uncertain as its covariance says.  Of the position, what is
    across the line of sight turns bearings too; it counts as it does halfway through the range.
    """
    x, y, yaw = cone.pose.planar_variances
    position_variance = 0.5 * (x + y)
    middle_m = 0.5 * cone.transducer.max_range_m
    bearing_std = math.sqrt(yaw + position_variance / middle_m**2)
    # In steps, so that few tables of gains are needed.
    return position_variance, HEADING_STEP_RAD * round(bearing_std / HEADING_STEP_RAD)


@lru_cache(maxsize=256)
def _power_gain(
    angles: bytes, gains: bytes, bearing_std_rad: float, half_angle_rad: float
) -> NDArray[np.float32]:
    """Table of a beam's power gain; the arrays come as bytes, which can be looked up."""
    beam = BeamPattern(np.frombuffer(angles), np.frombuffer(gains))
    versine = np.linspace(0.0, 1.0 - np.cos(half_angle_rad), GAIN_STEPS + 1)
    off_axis = np.arccos(1.0 - versine)
    # Gauss-Hermite quadrature over a normal distribution.
    off, weight = np.polynomial.hermite_e.hermegauss(HEADINGS if bearing_std_rad else 1)
    gains_squared = beam.gain(off_axis[:, np.newaxis] + bearing_std_rad * off) ** 2
    mean: NDArray[np.float32] = (gains_squared @ weight / weight.sum()).astype(np.float32)
    return mean
