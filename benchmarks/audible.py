"""Which poles a recording can have heard: far off or at the beam's edge they are too faint."""

from __future__ import annotations

import numpy as np
from recordings import Cones

from usmap_ros.evaluation.sight import PINGS_TO_KNOW
from usmap_ros.grids import TruthMap
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
    noise_std = scenario.robots[0].transducers[0].receiver.noise_std
    heard = np.zeros(len(poles), dtype=np.int64)
    for _, cone in recorded:
        ahead = poles.centers_m - cone.pose.position_m[:2]
        range_m = np.maximum(np.hypot(*ahead.T), 1e-3)
        turned = np.arctan2(ahead[:, 1], ahead[:, 0]) - cone.pose.yaw_rad
        bearing_rad = np.abs((turned + np.pi) % (2.0 * np.pi) - np.pi)
        transducer = cone.transducer
        inside = bearing_rad < transducer.beam.half_angle_rad
        gain = transducer.beam.gain(np.where(inside, bearing_rad, 0.0))
        loss = 10.0 ** (-cone.attenuation_db_m * range_m / 10.0)
        amplitude = poles.reflectivities * gain * loss / range_m**2
        in_reach = (range_m >= transducer.min_range_m) & (range_m <= transducer.max_range_m)
        heard += inside & in_reach & (amplitude >= LOUD_ENOUGH * noise_std)
    geometry = truth.geometry
    faint = poles.centers_m[heard < PINGS_TO_KNOW]
    columns, rows = np.floor((faint - geometry.origin_m) / geometry.resolution_m + 1e-9).T.astype(
        int
    )
    occupied = truth.occupied.copy()
    occupied[rows, columns] = False
    return TruthMap(geometry, occupied)
