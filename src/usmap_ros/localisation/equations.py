"""Normal equations of the knots of tracks: what odometry says, and how they are solved."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from usmap_ros.localisation.planar import between, derivatives
from usmap_ros.localisation.tracks import Track
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import wrapped

#: Least and most that odometry is off over what is stated, and errors that outweigh that.
_SPREADS, _USUAL = (0.05, 2.0), 4.0


def odometry_errors(track: Track, knots: FloatArray) -> FloatArray:
    """By how much changes from knot to knot differ from odometry."""
    errors = between(knots[:-1], knots[1:]) - track.increments
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
    stretched = (track.scale - 1.0) / track.scale_std
    return float(cost + start @ track.start_information() @ start + stretched**2)


def log_information(track: Track) -> float:
    """Logarithm of how well odometry alone knows all knots: of the root of the determinant."""
    steps = np.linalg.slogdet(track.informations)[1].sum()
    return 0.5 * float(steps + np.linalg.slogdet(track.start_information())[1])


class ScaleEquation(NamedTuple):
    """What the scale of a track's odometry depends on."""

    #: (knots, 3) array: with each knot.
    coupling: FloatArray
    #: Its own, and the right-hand side.
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
        information = track.scale_std**-2 - float(np.sum(weighed * track.ways))
        right = -(track.scale - 1.0) * track.scale_std**-2 - float(np.sum(weighed * errors))
        return cls(coupling, information, right)

    def eliminate(self, matrix: FloatArray, right: FloatArray) -> None:
        """Take the scale out of the equations of the track's knots."""
        coupling = self.coupling.ravel()
        matrix -= np.outer(coupling, coupling) / self.information
        right -= coupling * self.right / self.information

    def fit(self, track: Track) -> None:
        """Give the track the scale that its knots make most likely."""
        track.scale += self.right / self.information


def chain_blocks(track: Track, knots: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What odometry says of each two knots of a track that follow one another.

    Parameters
    ----------
    track : Track
        Whose.
    knots : (n, 3) array
        Poses.

    Returns
    -------
    matrix, right : (n - 1, 6, 6) and (n - 1, 6) arrays
        Both sides of their equations.
    """
    errors, change = odometry_errors(track, knots), derivatives(knots[:-1], knots[1:])
    weighed = np.swapaxes(change, 1, 2) @ track.informations
    return weighed @ change, -np.einsum("nij,nj->ni", weighed, errors)


def add_chain(
    track: Track, knots: FloatArray, matrix: FloatArray, right: FloatArray, first: int
) -> None:
    """Add what odometry says of the knots of a track to the equations of all.

    Parameters
    ----------
    track : Track
        Whose.
    knots : (n, 3) array
        Poses.
    matrix, right : arrays
        Both sides of the equations.
    first : int
        The row of the first knot there.
    """
    for step, (block, force) in enumerate(zip(*chain_blocks(track, knots), strict=True)):
        at = slice(first + 3 * step, first + 3 * step + 6)
        matrix[at, at] += block
        right[at] += force
    start, known = slice(first, first + 3), track.start_information()
    matrix[start, start] += known
    right[start] -= known @ start_error(track, knots)


def solve(matrix: FloatArray, right: FloatArray) -> tuple[FloatArray, tuple[FloatArray, bool]]:
    """Changes of all knots, (n, 3), and the decomposition for `covariances`."""
    factor = cho_factor(matrix, check_finite=False)
    change = np.asarray(cho_solve(factor, right, check_finite=False)).reshape(-1, 3)
    return change, factor


def covariances(
    factor: tuple[FloatArray, bool], count: int, first: int = 0, together: int = 1
) -> FloatArray:
    """Covariances of knots that follow one another, from the decomposition of their equations.

    Parameters
    ----------
    factor
        Of the equations of all knots.
    count : int
        Of covariances.
    first : int
        The first knot.
    together : int
        Knots whose covariance with each other is wanted.

    Returns
    -------
    (count, 3 together, 3 together) array
        Of each knot and the next ones.
    """
    size = 3 * (count + together - 1)
    unit = np.zeros((len(factor[0]), size))
    unit[3 * first : 3 * first + size] = np.eye(size)
    inverse = np.asarray(cho_solve(factor, unit, check_finite=False))[3 * first :]
    rows = 3 * np.arange(count)[:, np.newaxis] + np.arange(3 * together)
    return np.asarray(inverse[rows[:, :, np.newaxis], rows[:, np.newaxis, :]])


def found_spread(track: Track, knots: FloatArray, known: FloatArray) -> FloatArray:
    """How far odometry is off, over what is stated, by how far echoes have it off.

    The step of the evidence framework (MacKay, Neural Computation 1992): squared errors are shared
    out among as many of them as echoes tell, rather than odometry itself.

    Parameters
    ----------
    track : Track
        Whose.
    knots : (n, 3) array
        Poses, adjusted to echoes.
    known : (n - 1, 6, 6) array
        Covariances of each two that follow one another.

    Returns
    -------
    (3,) array
        As `Track.spread`.
    """
    prior = np.diagonal(np.linalg.inv(track.informations), axis1=1, axis2=2)
    change = derivatives(knots[:-1], knots[1:])
    left = np.einsum("nij,njk,nik->ni", change, known, change)
    told = 1.0 - np.minimum(left / prior, 1.0)
    squares = odometry_errors(track, knots) ** 2 / prior
    telling, off = told.sum(axis=0), squares.sum(axis=0) * track.spread**2
    # Places are off alike along and across the way.
    telling[:2], off[:2] = telling[:2].sum(), off[:2].sum()
    found = (off + _USUAL) / (telling + _USUAL)
    return np.asarray(np.clip(np.sqrt(found), *_SPREADS))
