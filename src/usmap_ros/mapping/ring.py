"""What an echo says of the cells on its ring.

An echo says that at least one cell of its ring is occupied: a noisy-OR.  What one cell gains
is what the echo still needs after what its ring-mates already explain, which is the message of
belief propagation from the echo to the cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from usmap_ros.cone import EchoCone
from usmap_ros.mapping.footprint import Footprint
from usmap_ros.mapping.grid import FloatArray, IndexArray
from usmap_ros.mapping.reflectivity import LogReflectivity, Silence
from usmap_ros.parameters import MappingParameters

#: Standard deviations of range beyond which a cell is not on an echo's ring.
RING_DEVIATIONS = 3.0
#: An amplitude is never taken for smaller than this share of its standard deviation.
LEAST_AMPLITUDE = 0.1
#: No amplitude is taken for smaller than this.
FAINTEST = 1e-30


@dataclass(frozen=True)
class Ring:
    """Pairs of an echo and a cell that may have returned it.

    Parameters
    ----------
    cells : (ring cells,) integer array
        Cells of the footprint that are on any ring.
    cell, echo : (pairs,) integer arrays
        Of each pair: its cell, as an index into `cells`, and its echo.
    range_fit : (pairs,) array
        Probability that the echo's range lies inside the cell.
    log_reflectivity : (pairs,) array
        ln s that the echo's amplitude would mean, had it come from the cell.
    variance : (pairs,) array
        Of `log_reflectivity`: noise of the amplitude and fluctuation from look to look.
    clutter : (pairs,) array
        Likelihood λ of the echo if it comes from no cell, relative to that of a perfect fit.
    echo_count : int
        Echoes in the cone.
    """

    cells: IndexArray
    cell: IndexArray
    echo: IndexArray
    range_fit: FloatArray
    log_reflectivity: FloatArray
    variance: FloatArray
    clutter: FloatArray
    echo_count: int


def find_ring(cone: EchoCone, footprint: Footprint, parameters: MappingParameters) -> Ring:
    """Pair every echo with the cells whose range it fits.

    Parameters
    ----------
    cone : EchoCone
        Echoes in ascending range.
    footprint : Footprint
        Cells of the cone.
    parameters : MappingParameters
        Error of ranges, fluctuation and clutter.
    """
    reach_m = footprint.half_depth_m + RING_DEVIATIONS * np.hypot(
        footprint.range_std_m, parameters.range_error_m
    )
    first = np.searchsorted(cone.ranges_m, footprint.range_m - reach_m)
    count = np.searchsorted(cone.ranges_m, footprint.range_m + reach_m) - first
    cells = np.flatnonzero(count)
    first, count = first[cells], count[cells]
    cell = np.repeat(np.arange(len(cells)), count)
    echo = np.arange(len(cell)) + np.repeat(first - (np.cumsum(count) - count), count)

    place = cells[cell]
    offset_m = cone.ranges_m[echo].astype(float) - footprint.range_m[place]
    std_m = np.sqrt(
        footprint.range_std_m[place] ** 2
        + cone.range_stds_m[echo].astype(float) ** 2
        + parameters.range_error_m**2
    )
    amplitude_std = cone.amplitude_stds[echo].astype(float)
    amplitude = np.maximum(cone.amplitudes[echo], LEAST_AMPLITUDE * amplitude_std)
    # An echo without any strength fits no cell, but must leave the logarithm finite.
    amplitude = np.maximum(amplitude, FAINTEST)
    variance = (amplitude_std / amplitude) ** 2 + parameters.fluctuation**2
    return Ring(
        cells=cells,
        cell=cell,
        echo=echo,
        range_fit=_range_fit(
            offset_m, footprint.half_depth_m[place], footprint.taper_m[place], std_m
        ),
        log_reflectivity=np.log(amplitude) - footprint.log_unit_amplitude[place],
        variance=variance,
        # Where echoes overlap, amplitudes are vague, and what is taken for one echo may be several
        # or none: both make it likelier that no single cell accounts for it.
        clutter=parameters.clutter * variance / parameters.fluctuation**2,
        echo_count=len(cone.ranges_m),
    )


def _range_fit(
    offset_m: FloatArray, half_depth_m: FloatArray, taper_m: FloatArray, std_m: FloatArray
) -> FloatArray:
    """Likelihood of a range offset for an object anywhere in a square cell, 1 at its best.

    The projection of a square on a ray is a trapezoid: a box smeared over the taper, for which
    a mean over three places stands.
    """
    plateau_m = half_depth_m - 0.5 * taper_m
    fit = np.zeros_like(offset_m)
    for place in (-1.0 / 3.0, 0.0, 1.0 / 3.0):
        shifted_m = offset_m + place * taper_m
        fit += ndtr((shifted_m + plateau_m) / std_m) - ndtr((shifted_m - plateau_m) / std_m)
    return fit / 3.0


def fit_to_ring(ring: Ring, belief: LogReflectivity, audibility: FloatArray) -> FloatArray:
    """Likelihood q of each pair's echo, had the cell returned it; 1 for a perfect fit.

    Parameters
    ----------
    ring : Ring
        Pairs of echo and cell.
    belief : LogReflectivity
        Of the ring's cells.
    audibility : (ring cells,) array
        Probability that a loud enough object is heard at all.
    """
    spread = belief.variance[ring.cell] + ring.variance
    misfit = (ring.log_reflectivity - belief.mean[ring.cell]) ** 2 / spread
    loudness_fit = np.sqrt(ring.variance / spread) * np.exp(-0.5 * misfit)
    fit: FloatArray = audibility[ring.cell] * ring.range_fit * loudness_fit
    return fit


@dataclass(frozen=True)
class RingEvidence:
    """What a ping says of the cells on its rings, each array of shape (ring cells,).

    Parameters
    ----------
    log_ratio : array
        Log-likelihood ratio of occupied against free.
    precision, information : arrays
        What is added to the belief about ln s.
    """

    log_ratio: FloatArray
    precision: FloatArray
    information: FloatArray


def ring_evidence(
    ring: Ring,
    probability: FloatArray,
    belief: LogReflectivity,
    quiet: Silence,
    audibility: FloatArray,
) -> RingEvidence:
    """Messages from the echoes to the cells of their rings.

    With q the likelihood of an echo given that a cell returned it, Q the probability that no
    ring-mate did, λ the likelihood of clutter and m that of a second object going unnoticed
    under the echo, an occupied cell makes the echo more likely by

        ((λ + 1 − Q) m + Q q) / (λ + 1 − Q).

    Parameters
    ----------
    ring : Ring
        Pairs of echo and cell.
    probability : (ring cells,) array
        Belief that each cell is occupied, without what this ping says.
    belief : LogReflectivity
        Of the ring's cells, without what this ping says.
    quiet : Silence
        What the cells would be told, had they not been heard.
    audibility : (ring cells,) array
        Probability that a loud enough object is heard at all.
    """
    cell, echo, count = ring.cell, ring.echo, len(ring.cells)
    returned = fit_to_ring(ring, belief, audibility)
    not_returned = np.log1p(-probability[cell] * returned)
    by_echo = np.bincount(echo, not_returned, ring.echo_count)
    # A sum without one of its terms, all of one sign: rounding must not change that.
    log_unexplained = np.minimum(by_echo[echo] - not_returned, 0.0)
    unexplained = np.exp(log_unexplained)
    otherwise = ring.clutter - np.expm1(log_unexplained)
    unnoticed = quiet.log_ratio[cell]
    occupied = otherwise * np.exp(unnoticed) + unexplained * returned
    gain = np.log(occupied / otherwise) - unnoticed
    source = unexplained * returned / occupied
    silent = np.maximum(1.0 - np.bincount(cell, source, count), 0.0)
    return RingEvidence(
        log_ratio=quiet.log_ratio + np.bincount(cell, gain, count),
        precision=np.bincount(cell, source / ring.variance, count) + silent * quiet.precision,
        information=np.bincount(cell, source * ring.log_reflectivity / ring.variance, count)
        + silent * quiet.information,
    )
