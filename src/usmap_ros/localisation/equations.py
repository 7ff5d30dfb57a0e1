"""Normal equations of the knots of tracks: what odometry says, and how they are solved."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solveh_banded

from usmap_ros.localisation.planar import between, derivatives
from usmap_ros.localisation.tracks import Track
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import wrapped

#: What is known of a pose that is held, as inverse covariance of x, y (m) and yaw (rad).
_HELD = np.diag([1.0 / 0.005**2, 1.0 / 0.005**2, 1.0 / 0.01**2])
#: Diagonals above the main one of a chain's equations.
_BAND = 5
#: How far off ways by odometry are as a whole, as a share.
_SCALE_STD = 0.03


def odometry_errors(track: Track, knots: FloatArray, first: int = 0) -> FloatArray:
    """By how much changes from knot to knot, from knot `first` on, differ from odometry."""
    errors = between(knots[:-1], knots[1:]) - track.increments[first : first + len(knots) - 1]
    errors[:, 2] = wrapped(errors[:, 2])
    return errors


def start_error(track: Track, knots: FloatArray) -> FloatArray:
    """By how much the first knot differs from what was told."""
    error = knots[0] - track.told[0]
    error[2] = wrapped(error[2])
    return np.asarray(error)


def odometry_cost(track: Track, knots: FloatArray) -> float:
    """Squared Mahalanobis distance of knots from what odometry says."""
    errors, start = odometry_errors(track, knots), start_error(track, knots)
    cost = np.einsum("ni,nij,nj->", errors, track.informations, errors)
    stretched = (track.scale - 1.0) / _SCALE_STD
    return float(cost + start @ track.start_information() @ start + stretched**2)


class ScaleEquation(NamedTuple):
    """What the scale of a track's odometry depends on.

    Parameters
    ----------
    coupling : (knots, 3) array
        With each knot.
    information, right : float
        Its own, and the right-hand side.
    """

    coupling: FloatArray
    information: float
    right: float

    @classmethod
    def of(cls, track: Track, knots: FloatArray) -> ScaleEquation:
        """For all knots of a track."""
        errors, change = odometry_errors(track, knots), derivatives(knots[:-1], knots[1:])
        weighed = -np.einsum("ni,nij->nj", track.ways, track.informations)
        coupling, by_change = np.zeros((len(knots), 3)), np.einsum("ni,nij->nj", weighed, change)
        coupling[:-1] += by_change[:, :3]
        coupling[1:] += by_change[:, 3:]
        information = _SCALE_STD**-2 - float(np.sum(weighed * track.ways))
        right = -(track.scale - 1.0) * _SCALE_STD**-2 - float(np.sum(weighed * errors))
        return cls(coupling, information, right)

    def eliminate(self, matrix: FloatArray, right: FloatArray) -> None:
        """Take the scale out of the equations of the track's knots."""
        coupling = self.coupling.ravel()
        matrix -= np.outer(coupling, coupling) / self.information
        right -= coupling * self.right / self.information

    def fitted(self, track: Track) -> Track:
        """The track with the scale that its knots make most likely."""
        return replace(track, scale=track.scale + self.right / self.information)


def chain(
    track: Track, knots: FloatArray, first: int = 0, *, is_held: bool = False
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Equations of odometry for consecutive knots.

    Parameters
    ----------
    track : Track
        Whose.
    knots : (n, 3) array
        Poses, from knot `first` on.
    first : int
        Which knot is the first.
    is_held : bool
        Whether the first one is where it is, rather than where it was told to be.

    Returns
    -------
    blocks : (n, 3, 3) array
        On the diagonal.
    above : (n - 1, 3, 3) array
        Beside it.
    right : (n, 3) array
        Right-hand sides.
    """
    blocks, right = np.zeros((len(knots), 3, 3)), np.zeros((len(knots), 3))
    errors, change = (
        odometry_errors(track, knots, first),
        derivatives(knots[:-1], knots[1:]),
    )
    weighed = np.swapaxes(change, 1, 2) @ track.informations[first : first + len(knots) - 1]
    both, pull = weighed @ change, -np.einsum("nij,nj->ni", weighed, errors)
    blocks[:-1] += both[:, :3, :3]
    blocks[1:] += both[:, 3:, 3:]
    right[:-1] += pull[:, :3]
    right[1:] += pull[:, 3:]
    if is_held:
        blocks[0] += _HELD
    else:
        known = track.start_information()
        blocks[0] += known
        right[0] -= known @ start_error(track, knots)
    return blocks, both[:, :3, 3:], right


def solve_chain(blocks: FloatArray, above: FloatArray, right: FloatArray) -> FloatArray:
    """Changes of knots, (n, 3), by a banded Cholesky decomposition."""
    count = len(blocks)
    band = np.zeros((_BAND + 1, 3 * count))
    for row in range(3):
        for column in range(3):
            if row <= column:
                band[_BAND - (column - row), column::3] = blocks[:, row, column]
            if count > 1:
                band[_BAND - (3 + column - row), 3 + column :: 3] = above[:, row, column]
    return np.asarray(solveh_banded(band, right.ravel())).reshape(count, 3)


def on_knots(
    knot: np.ndarray,
    share: FloatArray,
    information: FloatArray,
    gradient: FloatArray,
    blocks: FloatArray,
    above: FloatArray,
    right: FloatArray,
) -> None:
    """Add what is known of the x and y of pings to the equations of the knots around them.

    Parameters
    ----------
    knot, share : (n,) arrays
        The knot before each ping, and how far it is on the way to the next one.
    information, gradient : (n, 2, 2) and (n, 2) arrays
        Of the pings.
    blocks, above, right : arrays
        As of `chain`; added to.
    """
    last = len(blocks) - 1
    for side, part in ((0, 1.0 - share), (1, share)):
        at = np.minimum(knot + side, last)
        np.add.at(right[:, :2], at, part[:, np.newaxis] * gradient)
        np.add.at(blocks[:, :2, :2], at, (part**2)[:, np.newaxis, np.newaxis] * information)
    if last:
        mixed = (share * (1.0 - share))[:, np.newaxis, np.newaxis] * information
        np.add.at(above[:, :2, :2], np.minimum(knot, last - 1), mixed)


def solve(matrix: FloatArray, right: FloatArray) -> tuple[FloatArray, tuple[FloatArray, bool]]:
    """Changes of all knots, (n, 3), and the decomposition for `covariances`."""
    factor = cho_factor(matrix, check_finite=False)
    change = np.asarray(cho_solve(factor, right, check_finite=False)).reshape(-1, 3)
    return change, factor


def covariances(factor: tuple[FloatArray, bool], count: int) -> FloatArray:
    """Covariance of each knot, (n, 3, 3), from the decomposition of their equations."""
    inverse = np.asarray(cho_solve(factor, np.eye(3 * count), check_finite=False))
    rows = 3 * np.arange(count)[:, np.newaxis] + np.arange(3)
    return np.asarray(inverse[rows[:, :, np.newaxis], rows[:, np.newaxis, :]])
