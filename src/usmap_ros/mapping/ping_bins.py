"""One ping in bins of range, as fusion keeps it: echo powers and detection limits."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.numerics.compiled import compiled
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import LIMIT_AMPLITUDES, EchoCone

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


def ping_bins_of(cone: EchoCone, parameters: MappingParameters) -> PingBins:
    """Bring a cone into the form that fusion keeps.

    Parameters
    ----------
    cone : EchoCone
        A valid cone.
    parameters : MappingParameters
        Cell size and the error of range that nobody states.
    """
    transducer, beam = cone.transducer, cone.transducer.beam
    axis_x, axis_y, axis_z = cone.pose.rotation[:, 0]
    position_variance, bearing_std = _uncertainty(cone)
    half_angle = min(float(beam.half_angle_rad) + WIDENING_STDS * bearing_std, np.pi)
    bin_m = max(FINEST_BIN_M, parameters.resolution_m / BINS_PER_CELL)
    binned, noise = _binned_echoes(cone, bin_m, bearing_std)
    return PingBins(
        x_m=float(cone.pose.position_m[0]),
        y_m=float(cone.pose.position_m[1]),
        axis_x=float(axis_x),
        axis_y=float(axis_y),
        axis_z=float(axis_z),
        rise_m=float(cone.object_rise_m),
        heading_rad=float(np.arctan2(axis_y, axis_x)),
        half_angle_rad=half_angle,
        cos_half_angle=float(np.cos(half_angle)),
        least_range_m=float(transducer.min_range_m),
        greatest_range_m=float(transducer.max_range_m),
        absorption_per_m=float(4.0 * cone.attenuation_db_m * np.log(10.0) / 20.0),
        range_std_m=float(np.hypot(parameters.range_error_m, np.sqrt(position_variance))),
        bin_m=bin_m,
        power_gain=_power_gain(
            beam.angles_rad.tobytes(), beam.gains.tobytes(), bearing_std, half_angle
        ),
        noise=noise,
        **binned._asdict(),
    )


def _uncertainty(cone: EchoCone) -> tuple[float, float]:
    """Variance of the position along any direction, and standard deviation of bearings.

    Errors of successive poses are a bias that wanders: they do not average out over a few pings,
    and each ping is taken to be as uncertain as its covariance says.  Of the position, what is
    across the line of sight turns bearings too; it counts as it does halfway through the range.
    """
    covariance = cone.pose.planar_covariance
    position_variance = 0.5 * (covariance[0, 0] + covariance[1, 1])
    middle_m = 0.5 * cone.transducer.max_range_m
    bearing_std = math.sqrt(covariance[2, 2] + position_variance / middle_m**2)
    # In steps, so that few tables of gains are needed.
    return float(position_variance), HEADING_STEP_RAD * round(bearing_std / HEADING_STEP_RAD)


class BinnedEchoes(NamedTuple):
    """What a ping has of each range bin; see `PingBins`."""

    kind: NDArray[np.uint8]
    power: NDArray[np.float32]
    next_echo: NDArray[np.int32]
    limit: NDArray[np.float32]
    bearing: NDArray[np.float32]
    bearing_weight: NDArray[np.float32]


def _binned_echoes(
    cone: EchoCone, bin_m: float, bearing_std_rad: float
) -> tuple[BinnedEchoes, float]:
    """What was heard in each range bin, and the power of the noise.

    Parameters
    ----------
    cone : EchoCone
        One ping's echoes and detection limits.
    bin_m : float
        Width of a bin.
    bearing_std_rad : float
        Of bearings, by the uncertainty of the pose.
    """
    start_m, stop_m = cone.transducer.min_range_m, cone.transducer.max_range_m
    bins = max(1, math.ceil((stop_m - start_m) / bin_m - 1e-9))
    binned = BinnedEchoes(
        kind=np.empty(bins, np.uint8),
        power=np.zeros(bins, np.float32),
        next_echo=np.empty(bins + 1, np.int32),
        limit=np.empty(bins, np.float32),
        bearing=np.zeros(bins, np.float32),
        bearing_weight=np.zeros(bins, np.float32),
    )
    # Copies: what comes from messages cannot be written to, and would be compiled for once more.
    codes, counts = cone.detection_limits.astype(np.uint8), np.zeros(len(LIMIT_AMPLITUDES), np.intp)
    noise = _bin_limits(codes, cone.limit_step_m, bin_m, LIMIT_AMPLITUDES, counts, binned)
    place = (cone.ranges_m.astype(float) - start_m) / bin_m
    _bin_echoes(place, cone.amplitudes.astype(float), binned)
    if cone.bearings_rad is not None and cone.bearing_stds_rad is not None:
        _set_bearings(place, cone.bearings_rad, cone.bearing_stds_rad, bearing_std_rad, binned)
    return binned, noise


@compiled
def _bin_limits(
    codes: NDArray[np.uint8],
    step_m: float,
    bin_m: float,
    amplitudes: FloatArray,
    counts: IndexArray,
    binned: BinnedEchoes,
) -> float:
    """Set each range bin's limit, and whether it was listened to; returns the power of the noise.

    Parameters
    ----------
    codes : (steps,) uint8 array
        `detection_limits` of a cone.
    step_m, bin_m : float
        Widths of a step, and of a range bin.
    amplitudes : (256,) array
        That codes stand for, rising.
    counts : (256,) integer array of zeros
        Set to the number of bins that were listened to with each code.
    binned : BinnedEchoes
        `kind` and `limit` are set.
    """
    total = 0
    for b in range(len(binned.kind)):
        code = codes[min(int((b + 0.5) * bin_m / step_m), len(codes) - 1)]
        limit = min(amplitudes[code], DEAF_AMPLITUDE)
        binned.kind[b], binned.limit[b] = UNJUDGED, limit * limit
        if limit < DEAF_AMPLITUDE:
            binned.kind[b] = SILENCE
            counts[code] += 1
            total += 1
    if total == 0:
        return 1.0
    # The median: of an even number, between the two in the middle.
    below, median = 0, 0.0
    for code in range(len(counts)):
        for middle in ((total - 1) // 2, total // 2):
            if below <= middle < below + counts[code]:
                median += 0.5 * amplitudes[code]
        below += counts[code]
    return max(NOISE_BELOW_LIMIT * median * median, LEAST_NOISE)


@compiled
def _bin_echoes(place: FloatArray, amplitudes: FloatArray, binned: BinnedEchoes) -> None:
    """Put echoes into range bins.

    Parameters
    ----------
    place : (echoes,) array
        Their ranges, counted in bins.
    amplitudes : (echoes,) array
        Amplitude of each echo, 1 for an ideal point target at 1 m.
    binned : BinnedEchoes
        `kind`, `power` and `next_echo` are set.
    """
    bins = len(binned.kind)
    for echo in range(len(place)):
        # An echo a hair's breadth away may have fallen into its neighbour.
        for beside in (int(place[echo]) - 1, int(place[echo]) + 1):
            if 0.0 <= place[echo] < bins and 0 <= beside < bins:
                binned.kind[beside] = UNJUDGED
    for echo in range(len(place)):
        if 0.0 <= place[echo] < bins:
            binned.kind[int(place[echo])] = ECHO
            binned.power[int(place[echo])] += amplitudes[echo] * amplitudes[echo]
    following = NEVER
    for b in range(bins, -1, -1):
        if b < bins and binned.kind[b] == ECHO:
            following = b
        binned.next_echo[b] = following


def _set_bearings(
    place: FloatArray,
    bearings_rad: NDArray[np.float32],
    stds_rad: NDArray[np.float32],
    pose_std_rad: float,
    binned: BinnedEchoes,
) -> None:
    """Set the bearing of the echo in each range bin, and its weight."""
    known = ~np.isnan(bearings_rad) & (place >= 0.0) & (place < len(binned.kind))
    at = place[known].astype(np.intp)
    binned.bearing[at] = bearings_rad[known]
    binned.bearing_weight[at] = 0.5 / (stds_rad[known] ** 2 + pose_std_rad**2)


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
