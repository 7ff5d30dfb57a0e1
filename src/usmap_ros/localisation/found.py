"""Poses that a search ends with."""

from dataclasses import dataclass

import numpy as np

from usmap_ros.localisation.smoother import KnotCovariances, Smoother
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import wrapped


@dataclass(frozen=True)
class FoundPoses:
    """Poses that were found."""

    #: (n, 3) array: x, y (m) and yaw (rad).
    poses: FloatArray
    #: (n, 3, 3) array: of these in the frame; NaN of poses that were not looked for.
    covariances: FloatArray
    #: (n, 3, 3) array: the same against what all pings hear, which a map is made of.  All that
    #: stands may be shifted or turned alike, and nothing is blurred by that.
    to_landmarks: FloatArray


def of_pings(smoother: Smoother, at_knots: KnotCovariances) -> FoundPoses:
    """The poses as they are, with covariances between those of the knots.

    Parameters
    ----------
    smoother : Smoother
        With poses that were found.
    at_knots : KnotCovariances
        How well the knots are known.
    """
    between = [_between_knots(smoother, known) for known in at_knots]
    return FoundPoses(smoother.poses.copy(), *between)


def _between_knots(smoother: Smoother, at_knots: FloatArray) -> FloatArray:
    """Covariances of pings from those of the knots, (knots, 3, 3)."""
    known = np.full((len(smoother.poses), 3, 3), np.nan)
    for number, first in smoother.first.items():
        rows = smoother.tracks[number].rows
        before, share = smoother.knot[rows], smoother.share[rows][:, np.newaxis, np.newaxis]
        after = np.minimum(before + 1, first + len(smoother.knots[number]) - 1)
        known[rows] = (1.0 - share) * at_knots[before] + share * at_knots[after]
    return known


def average(ends: list[tuple[float, FoundPoses]]) -> FoundPoses:
    """Poses that the ends of several searches have on average, by how likely they are.

    What they differ by is uncertain, and counts as such.

    Parameters
    ----------
    ends : list of (float, FoundPoses)
        With the logarithm of how likely each is.
    """
    gained = np.array([one for one, _ in ends])
    weights = np.exp(gained - gained.max())
    weights /= weights.sum()
    first = ends[0][1].poses
    apart = np.array([one.poses - first for _, one in ends])
    apart[:, :, 2] = wrapped(apart[:, :, 2])
    mean = np.einsum("e,enj->nj", weights, apart)
    off = apart - mean
    spread = np.einsum("e,eni,enj->nij", weights, off, off)
    within, to_landmarks = (
        np.einsum("e,enij->nij", weights, np.array(known))
        for known in zip(*((one.covariances, one.to_landmarks) for _, one in ends), strict=True)
    )
    poses = first + mean
    poses[:, 2] = wrapped(poses[:, 2])
    return FoundPoses(poses, within + spread, to_landmarks + spread)
