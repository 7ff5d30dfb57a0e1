"""Direction of an echo from the time difference between two receivers.

"One could conceivably also use time delays between detection at the two sensors to measure
direction" (Sanchez & Andersson, DSCC 2018-9140, section 3).  A transducer hears an object at the
distance r, another one at the distance s, and they are b apart.  The law of cosines gives the angle
ψ between the baseline and the object,

    cos ψ = (r² + b² − s²) / (2 r b),

and the object stands on either side of the baseline by ψ, where all are at one height; objects that
are higher or lower by a known rise, and transducers above one another, add their part.  Where the
baseline lies across the beam, one of the two is behind the transducer.  Far away this is
sin θ = (s − r) / b: a difference
known to σ gives a bearing known to σ / (b cos θ).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.reconstruction.cones import RecoveredEchoes

#: Standard deviation of ln amplitude between two receivers, beyond what noise makes.
AMPLITUDE_SPREAD = 0.3
#: Misfit (χ²) above which two echoes are not of one object, and by which the best partner must be
#: better than any other to be believed.
LARGEST_MISFIT = 16.0
LEAST_ADVANTAGE = 4.0
#: Gain below which a beam counts as silent.
_LEAST_GAIN = 1e-3
#: Step of numerical derivatives of bearings.
_STEP_M = 1e-5


@dataclass(frozen=True)
class Viewpoint:
    """A transducer that bearings are found for."""

    #: Of its frame in one that is level, with the x axis above or below its own.
    tilt: Pose
    #: Gain of its transducer over the angle off axis.
    beam: BeamPattern
    #: Height of the objects above it.
    rise_m: float = 0.0

    @classmethod
    def of(cls, pose: Pose, beam: BeamPattern, rise_m: float) -> Viewpoint:
        """Viewpoint of a transducer at a pose in the world."""
        ahead = Pose.planar(0.0, 0.0, -pose.yaw_rad)
        tilt = ahead.compose(Pose(np.zeros(3), pose.orientation))
        return cls(tilt, beam, rise_m)

    def points_m(self, range_m: FloatArray, bearing_rad: FloatArray) -> FloatArray:
        """Where objects are in the level frame, shape (..., 3)."""
        ground_m = np.sqrt(np.maximum(range_m**2 - self.rise_m**2, 0.0))
        return np.stack(
            [
                ground_m * np.cos(bearing_rad),
                ground_m * np.sin(bearing_rad),
                np.full_like(bearing_rad, self.rise_m),
            ],
            axis=-1,
        )


@dataclass(frozen=True)
class Sighting:
    """Echoes that another transducer had a part in, beside those of the transducer itself."""

    #: Of the other transducer, in the frame of the first.
    mount: Pose
    #: Of the other transducer.
    beam: BeamPattern
    #: Whether the first transducer is one end of the paths, so that half their length is
    #: (r + s) / 2; otherwise the other is both ends, and it is s.
    shares: bool
    #: With half the lengths of the direct paths as ranges.
    echoes: RecoveredEchoes

    def distances_m(self, own_m: FloatArray, halves_m: FloatArray) -> FloatArray:
        """Distance s of the object from the other transducer."""
        return 2.0 * halves_m - own_m if self.shares else halves_m


def find_bearings(
    own: RecoveredEchoes, view: Viewpoint, sightings: list[Sighting]
) -> tuple[FloatArray, FloatArray]:
    """Bearing of every echo that a sighting tells the direction of.

    Parameters
    ----------
    own : RecoveredEchoes
        Of the transducer's own pulse, heard by itself.
    view : Viewpoint
        Where the transducer is whose echoes get bearings, and its beam.
    sightings : list of Sighting
        What others heard of the same objects.

    Returns
    -------
    bearings_rad, stds_rad : (echoes,) arrays
        As seen from above, off the beam axis and positive to the left, and standard deviations;
        NaN where no sighting fits, or more than one object would.
    """
    weights = np.zeros(len(own.ranges_m))
    total = np.zeros(len(own.ranges_m))
    for sighting in sightings:
        bearings, stds = _from_sighting(own, view, sighting)
        known = np.isfinite(bearings)
        weights[known] += stds[known] ** -2.0
        total[known] += bearings[known] / stds[known] ** 2.0
    with np.errstate(divide="ignore", invalid="ignore"):
        return total / weights, np.where(weights > 0.0, weights**-0.5, np.nan)


def _from_sighting(
    own: RecoveredEchoes, view: Viewpoint, sighting: Sighting
) -> tuple[FloatArray, FloatArray]:
    """Bearings from the partner of each echo, where it has one for certain."""
    nothing = np.full(len(own.ranges_m), np.nan)
    if not len(own.ranges_m) or not len(sighting.echoes.ranges_m):
        return nothing, nothing.copy()
    range_m, half_m = own.ranges_m[:, np.newaxis], sighting.echoes.ranges_m[np.newaxis]
    bearing = bearings_of(range_m, half_m, view, sighting)
    misfit = _misfit(own, view, sighting, bearing)
    # Not needed where transducers ping alone, and long to import.
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(misfit)
    sure = _is_sure(misfit, rows, columns)
    rows, columns = rows[sure], columns[sure]
    bearings, stds = nothing.copy(), nothing.copy()
    bearings[rows] = bearing[rows, columns]
    by_range = bearings_of(range_m + _STEP_M, half_m, view, sighting) - bearing
    by_half = bearings_of(range_m, half_m + _STEP_M, view, sighting) - bearing
    stds[rows] = (
        np.hypot(
            by_range[rows, columns] * own.range_stds_m[rows],
            by_half[rows, columns] * sighting.echoes.range_stds_m[columns],
        )
        / _STEP_M
    )
    unknown = ~(stds > 0.0)
    bearings[unknown], stds[unknown] = np.nan, np.nan
    return bearings, stds


def bearings_of(
    range_m: FloatArray, half_m: FloatArray, view: Viewpoint, sighting: Sighting
) -> FloatArray:
    """Bearing of an object that is heard at `range_m`, and at `half_m` by a sighting.

    Parameters
    ----------
    range_m : (...) array
        Distance from the transducer.
    half_m : (...) array
        Half the length of the sighting's path.
    view : Viewpoint
        The transducer; its beam says which side of the baseline is meant.
    sighting : Sighting
        Gives the baseline.

    Returns
    -------
    (...) array
        As seen from above, off the beam axis and positive to the left; NaN where there is no such
        object in the beam, or one on either side of the baseline.
    """
    ahead_m, left_m, up_m = view.tilt.compose(sighting.mount).position_m
    base_m, square = float(np.hypot(ahead_m, left_m)), ahead_m**2 + left_m**2 + up_m**2
    other_m = sighting.distances_m(range_m, half_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        ground_m = np.sqrt(range_m**2 - view.rise_m**2)
        across = range_m**2 + square - other_m**2 - 2.0 * up_m * view.rise_m
        angle = np.arccos(across / (2.0 * ground_m * base_m))
    direction = np.arctan2(left_m, ahead_m)
    sides = np.angle(np.exp(1j * (direction + np.stack([angle, -angle]))))
    _, off_axis = view.tilt.polar(view.points_m(range_m, sides))
    inside = np.abs(off_axis) < view.beam.half_angle_rad
    chosen = np.where(inside[0], sides[0], sides[1])
    return np.where(inside[0] != inside[1], chosen, np.nan)


def _misfit(
    own: RecoveredEchoes, view: Viewpoint, sighting: Sighting, bearing: FloatArray
) -> FloatArray:
    """How much amplitudes speak against two echoes being of one object, χ² of each pair.

    Pairs whose lengths fit no object in the beam have a misfit that rules them out.
    """
    echoes = sighting.echoes
    range_m = own.ranges_m[:, np.newaxis]
    other_m = sighting.distances_m(range_m, echoes.ranges_m[np.newaxis])
    points_m = view.points_m(range_m, bearing)
    _, seen_at = view.tilt.compose(sighting.mount).polar(points_m)
    _, own_seen_at = view.tilt.polar(points_m)
    own_gain = np.maximum(view.beam.gain(own_seen_at), _LEAST_GAIN)
    other_gain = np.maximum(sighting.beam.gain(seen_at), _LEAST_GAIN)
    with np.errstate(divide="ignore", invalid="ignore"):
        # One leg and one way differ where the paths share the transducer, both where they do not.
        expected = np.log(other_gain / own_gain * (range_m / other_m) ** 2)
        expected *= 0.5 if sighting.shares else 1.0
        ratio = np.log(echoes.amplitudes[np.newaxis] / own.amplitudes[:, np.newaxis])
    variance = (
        AMPLITUDE_SPREAD**2
        + (own.amplitude_stds / own.amplitudes)[:, np.newaxis] ** 2
        + (echoes.amplitude_stds / echoes.amplitudes)[np.newaxis] ** 2
    )
    misfit = (ratio - expected) ** 2 / variance
    return np.where(np.isfinite(misfit), np.minimum(misfit, LARGEST_MISFIT), LARGEST_MISFIT)


def _is_sure(misfit: FloatArray, rows: IndexArray, columns: IndexArray) -> BoolArray:
    """Whether each pair fits, and neither of its echoes fits about as well elsewhere."""
    best = misfit[rows, columns]
    others = misfit.copy()
    others[rows, columns] = np.inf
    rival = np.minimum(others.min(axis=1)[rows], others.min(axis=0)[columns])
    sure: BoolArray = (best < LARGEST_MISFIT) & (
        (rival >= LARGEST_MISFIT) | (rival - best > LEAST_ADVANTAGE)
    )
    return sure
