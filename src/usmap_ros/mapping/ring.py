"""The cells that each echo of a cone may have come from: its ring."""

from dataclasses import dataclass

import numpy as np

from usmap_ros.mapping.footprint import Footprint
from usmap_ros.numerics.arrays import IndexArray, RealArray, spans
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Standard deviations of range beyond which a cell is not on an echo's ring.
RING_DEVIATIONS = 3.0
#: An amplitude is never taken for smaller than this share of its standard deviation.
LEAST_AMPLITUDE = 0.1
#: No amplitude is taken for smaller than this.
FAINTEST = 1e-30


@dataclass(frozen=True)
class Ring:
    """Pairs of an echo and a cell that may have returned it."""

    #: (ring cells,) integer array: cells of the footprint that are on any ring.
    cells: IndexArray
    #: (pairs,) integer arrays: of each pair: its cell, as an index into `cells`, and its echo.
    cell: IndexArray
    echo: IndexArray
    #: (pairs,) array: probability that the echo's range lies inside the cell.
    range_fit: RealArray
    #: (pairs,) array: ln s that the echo's amplitude would mean, had it come from the cell.
    log_reflectivity: RealArray
    #: (pairs,) array: of `log_reflectivity`: noise of the amplitude and fluctuation from look to
    #: look.
    variance: RealArray
    #: Echoes in the cone.
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
        Error of ranges and fluctuation.
    """
    reach_m = footprint.half_depth_m + RING_DEVIATIONS * np.hypot(
        footprint.range_std_m, parameters.range_error_m
    )
    first = np.searchsorted(cone.ranges_m, footprint.range_m - reach_m)
    count = np.searchsorted(cone.ranges_m, footprint.range_m + reach_m) - first
    cells = np.flatnonzero(count)
    first, count = first[cells], count[cells]
    cell = np.repeat(np.arange(len(cells)), count)
    echo = spans(first, count)

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
        echo_count=len(cone.ranges_m),
    )


def _range_fit(
    offset_m: RealArray, half_depth_m: RealArray, taper_m: RealArray, std_m: RealArray
) -> RealArray:
    """Likelihood of a range offset for an object anywhere in a square cell, 1 at its best.

    The projection of a square on a ray is a trapezoid: a box smeared over the taper, for which
    a mean over three places stands.
    """
    # Here, because it takes long to load, and the default way of mapping does without.
    from scipy.special import ndtr

    plateau_m = half_depth_m - 0.5 * taper_m
    fit = np.zeros_like(offset_m)
    for place in (-1.0 / 3.0, 0.0, 1.0 / 3.0):
        shifted_m = offset_m + place * taper_m
        fit += ndtr((shifted_m + plateau_m) / std_m) - ndtr((shifted_m - plateau_m) / std_m)
    return fit / 3.0
