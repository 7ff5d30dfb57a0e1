"""Directions off a ping's beam, and how well it hears there."""

from __future__ import annotations

import math

from usmap_ros.mapping.joint.field import HALF_ANGLE, HEADING
from usmap_ros.mapping.looks import Looks
from usmap_ros.mapping.ping_bins import GAIN_STEPS
from usmap_ros.numerics.compiled import inlined

#: Share of the half angle within which a smooth thing must answer for a ping to count; and how far
#: within the least and the greatest range, m.
LOOKING_SHARE, WITHIN_LEAST_M, WITHIN_GREATEST_M = 0.93, 0.02, 0.05


@inlined
def off_axis(looks: Looks, ping: int, bearing_rad: float) -> float:
    """Angle of a direction off a beam's axis, between -π and π."""
    off: float = bearing_rad - looks.numbers[ping, HEADING]
    return off - 2.0 * math.pi * math.floor((off + math.pi) / (2.0 * math.pi))


@inlined
def amplitude_gain(looks: Looks, ping: int, off_rad: float) -> float:
    """Amplitude gain of a beam at an angle off its axis."""
    half = looks.numbers[ping, HALF_ANGLE]
    entry = int((1.0 - math.cos(off_rad)) / (1.0 - math.cos(half)) * GAIN_STEPS)
    return math.sqrt(looks.power_gain[ping, min(max(entry, 0), GAIN_STEPS)])
