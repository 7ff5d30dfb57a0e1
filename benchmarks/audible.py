"""Where a recording can have heard poles: far off or at the beam's edge they are too faint."""

from __future__ import annotations

import numpy as np
from recordings import Cones
from scipy.ndimage import binary_dilation

from usmap_ros.evaluation.alignment import align
from usmap_ros.evaluation.drivability import share
from usmap_ros.evaluation.sight import PINGS_TO_KNOW
from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.numerics.arrays import FloatArray, IntArray
from usmap_ros.numerics.geometry import wrapped
from usmap_ros.simulation import Scenario

#: Times the receiver's noise an echo's amplitude has to be.
LOUD_ENOUGH = 4.0


def audible_poles(scenario: Scenario, recorded: Cones, truth: TruthMap) -> TruthMap:
    """The truth without the poles that are not loud enough to be heard twice.

    Parameters
    ----------
    scenario : Scenario
        Of lone poles.
    recorded : list of (topic, cone)
        Its pings.
    truth : TruthMap
        All poles.
    """
    poles = scenario.scene().discs
    heard = _times_heard(poles.centers_m, poles.reflectivities, scenario, recorded)
    geometry = truth.geometry
    faint = poles.centers_m[heard < PINGS_TO_KNOW]
    columns, rows = np.floor((faint - geometry.origin_m) / geometry.resolution_m + 1e-9).T.astype(
        int
    )
    occupied = truth.occupied.copy()
    occupied[rows, columns] = False
    return TruthMap(geometry, occupied)


def known_where_audible(
    scenario: Scenario, recorded: Cones, occupancy: OccupancyMap, truth: TruthMap
) -> float:
    """The share of open cells called free, of those where the scene's median pole would be heard.

    Parameters
    ----------
    scenario, recorded, truth
        As in `audible_poles`.
    occupancy : OccupancyMap
        The map.
    """
    maps = align(occupancy, truth)
    rows, columns = np.nonzero(maps.charted & ~binary_dilation(maps.occupied, np.ones((3, 3))))
    usual = np.full(len(rows), np.median(scenario.scene().discs.reflectivities))
    places_m = maps.geometry.cell_centers_m(rows, columns)
    is_audible = _times_heard(places_m, usual, scenario, recorded) >= PINGS_TO_KNOW
    could_be_known = np.zeros(maps.occupied.shape, bool)
    could_be_known[rows[is_audible], columns[is_audible]] = True
    return share(maps.free, could_be_known)


def _times_heard(
    places_m: FloatArray, reflectivities: FloatArray, scenario: Scenario, recorded: Cones
) -> IntArray:
    """How many pings return an echo that is loud enough from points at some places."""
    noise_std = scenario.robots[0].transducers[0].receiver.noise_std
    heard = np.zeros(len(places_m), dtype=np.int64)
    for _, cone in recorded:
        ahead = places_m - cone.pose.position_m[:2]
        range_m = np.maximum(np.hypot(*ahead.T), 1e-3)
        turned = np.arctan2(ahead[:, 1], ahead[:, 0]) - cone.pose.yaw_rad
        bearing_rad = np.abs(wrapped(turned))
        transducer = cone.transducer
        inside = bearing_rad < transducer.beam.half_angle_rad
        gain = transducer.beam.gain(np.where(inside, bearing_rad, 0.0))
        loss = 10.0 ** (-cone.attenuation_db_m * range_m / 10.0)
        amplitude = reflectivities * gain * loss / range_m**2
        in_reach = (range_m >= transducer.min_range_m) & (range_m <= transducer.max_range_m)
        heard += inside & in_reach & (amplitude >= LOUD_ENOUGH * noise_std)
    return heard
