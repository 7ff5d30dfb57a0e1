"""Walls of a place are mostly parallel or square to each other.

What is usual is not stated: a direction, and how many lines keep to it, are found with the lines,
as a mixture of those that do and of those that face anywhere (expectation maximisation).  So the
walls of rooms tell robots how they have turned (orthogonal SLAM: Nguyen, Harati, Martinelli,
Siegwart & Tomatis, IROS 2006), and lines that chance has among poles tell nothing.
"""

import math
from typing import NamedTuple

import numpy as np

from usmap_ros.numerics.arrays import FloatArray

#: Directions that are the same, rad.
_QUARTER = 0.5 * math.pi
#: How far walls are off them, rad (standard deviation): themselves, and for each metre that ranges
#: and poses are off.
_OFF_RAD, _OFF_RAD_PER_M = 0.006, 0.3
#: How far robots turn lines that they hear beside that, rad.
_TURNED_RAD = 0.009
#: Echoes that make a line as likely a wall as chance.
_SURE_ECHOES = 10.0
#: Steps of expectation maximisation, and the share of walls that it begins with, and at the most.
_STEPS, _FIRST_SHARE, _MOST_SHARE = 6, 0.5, 0.95
#: Log-likelihood over that of lines that face anywhere, at the least: chance lines up some of them.
_LEAST_GAIN = 6.0


class Squareness(NamedTuple):
    """How lines keep to one direction."""

    #: (n,) array: how likely each does.
    shares: FloatArray
    #: (n,) array: by how much each is off it, to the nearest quarter turn.
    off_rad: FloatArray
    #: How far those that do are off it.
    std_rad: float
    #: Log-likelihood of all directions over that of lines that face anywhere.
    gain: float

    def information(self) -> FloatArray:
        """Of the lines' directions, (n, n), whatever the direction is that they keep to."""
        total = max(float(self.shares.sum()), 1e-9)
        own = np.diag(self.shares) - np.outer(self.shares, self.shares) / total
        return np.asarray(own / self.std_rad**2)


def squareness(
    normals_rad: FloatArray, echoes: FloatArray, stds_rad: FloatArray, sigma_m: float
) -> Squareness:
    """How lines keep to the direction that most of them keep to, if they do.

    Parameters
    ----------
    normals_rad : (n,) array
        Their normals.
    echoes : (n,) array
        How many each line has: one of few is hardly a wall.
    stds_rad : (n,) array
        How well they tell its normal: one that they tell badly may keep to the direction though it
        seems not to.
    sigma_m : float
        How far ranges and poses are off.
    """
    std_rad = max(_OFF_RAD, _OFF_RAD_PER_M * sigma_m)
    nothing = Squareness(0.0 * normals_rad, 0.0 * normals_rad, std_rad, 0.0)
    if np.count_nonzero(echoes) < 2:
        return nothing
    seen_rad = np.sqrt(std_rad**2 + stds_rad**2 + _TURNED_RAD**2)
    are_walls = echoes / (echoes + _SURE_ECHOES)
    off_rad = _off(normals_rad - normals_rad[:, np.newaxis])
    off_rad = off_rad[np.argmax(_density(off_rad, seen_rad) @ are_walls)]
    share, shares = _FIRST_SHARE, are_walls
    for _ in range(_STEPS):
        density = share * are_walls * _density(off_rad, seen_rad)
        shares = density / (density + 1.0 - share * are_walls)
        share = min(float(shares.sum() / are_walls.sum()), _MOST_SHARE)
        weights = shares / seen_rad**2
        off_rad = _off(off_rad - weights @ off_rad / weights.sum())
    keep = share * are_walls
    likelihood = np.log(1.0 - keep + keep * _density(off_rad, seen_rad))
    gain = float(likelihood.sum()) - _LEAST_GAIN
    return Squareness(shares, off_rad, std_rad, gain) if gain > 0.0 else nothing


def _off(turn_rad: FloatArray) -> FloatArray:
    """Turns to the nearest quarter turn."""
    return np.asarray(turn_rad - _QUARTER * np.round(turn_rad / _QUARTER))


def _density(off_rad: FloatArray, std_rad: FloatArray) -> FloatArray:
    """Of lines that keep to a direction, over that of lines that face anywhere."""
    peak = _QUARTER / (std_rad * math.sqrt(2.0 * math.pi))
    return np.asarray(peak * np.exp(-0.5 * (off_rad / std_rad) ** 2))
