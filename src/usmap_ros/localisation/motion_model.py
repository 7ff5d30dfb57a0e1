"""Where a robot was by how steadily it moves: poses that are off by chance, smoothed.

A robot's velocity in its own axes changes slowly: wheels drive it where it faces.  That makes the
places between pings a Gaussian process, integrated twice from white noise, whose observations are
the poses that were told: a fixed-interval smoother, as a smoothing spline is (Wahba, JRSS B 1978).
In the eigenvectors of the prior's precision (Demmler & Reinsch 1975) all is diagonal, so that the
likelihood of the noises is known for all of a grid of them at once.  A robot that starts, stops or
bumps breaks the rule for once: changes have Student's t, by reweighting (Lange, Little & Taylor,
JASA 1989).

Errors that wander look like motion.  What share of the error is anew at each ping is found with
the motion, and no more than that is smoothed away.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import wrapped

#: Pings that are smoothed together, and so many without which nothing is.
_PIECE, _LEAST_PINGS = 100, 12
#: Shares of the standard deviation that may be anew at each ping; and what changes from one ping to
#: the next may be, over that standard deviation.
_SHARES, _CHANGES = np.array([1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1]), np.geomspace(0.02, 5.0, 24)
#: Degrees of freedom of Student's t, rounds of reweighting at the most, and by how much no weight
#: changes any more once it has settled.
_FREEDOM, _ROUNDS, _SETTLED = 2.0, 20, 0.05
#: Directions that a step may be along: the heading before it, midway, or after it, as shares of
#: the turn, for who stamps poses when differs; and none, of what moves anywhere.
_ALONG = (0.5, 0.0, 1.0, None)
_LEAST_S, _TINY = 1e-6, 1e-12


class _Piece(NamedTuple):
    """Part of a track; unknowns over their standard deviations, in units of the mean one."""

    #: (changes, axes, unknowns) array: rows of what is white noise.
    changes: FloatArray
    #: (unknowns,) array: as told.
    told: FloatArray


class _Noises(NamedTuple):
    """Standard deviations of what is anew at each ping, and of changes of velocity."""

    white: float
    change: float
    log_likelihood: float


class _Spectrum(NamedTuple):
    """A piece in the eigenvectors of its prior's precision."""

    #: (unknowns,) array: precision of each eigenvector; 0 of those of which it knows nothing.
    precisions: FloatArray
    #: (unknowns, unknowns) array.
    vectors: FloatArray
    #: (unknowns,) array: what was told.
    told: FloatArray

    def kept(self, noises: _Noises) -> FloatArray:
        """Share of each eigenvector that is not smoothed away."""
        return np.asarray(1.0 / (1.0 + (noises.white / noises.change) ** 2 * self.precisions))

    def likeliest(self, noises: _Noises) -> FloatArray:
        """The unknowns."""
        return np.asarray(self.vectors @ (self.kept(noises) * self.told))


class _Fit(NamedTuple):
    """Pieces of a track, and the noises by which what was told is likeliest."""

    pieces: list[_Piece]
    spectra: list[_Spectrum]
    noises: _Noises


def smoothed(
    stamps_s: FloatArray, poses: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Poses of one transducer by how steadily it moves.

    Parameters
    ----------
    stamps_s : (n,) array
        When each ping was, ascending.
    poses : (n, 3) array
        x, y (m) and yaw (rad), as told: right but for errors by chance.
    covariances : (n, 3, 3) array
        Of these errors.

    Returns
    -------
    poses : (n, 3) array
        The most likely ones.
    covariances : (n, 3, 3) array
        Of these, each by itself.
    """
    variances = 0.5 * (covariances[:, 0, 0] + covariances[:, 1, 1])
    if len(poses) < _LEAST_PINGS or not variances.all():
        return poses, covariances
    pieces = np.array_split(np.arange(len(poses)), -(-len(poses) // _PIECE))
    yaw_rad, kept_yaw = _smoothed_yaw(stamps_s, poses[:, 2], covariances[:, 2, 2], pieces)
    places_m, kept = _smoothed_places(stamps_s, poses[:, :2], variances, yaw_rad, pieces)
    shares = np.sqrt(np.stack([kept, kept, kept_yaw], axis=1))
    known = covariances * shares[:, :, np.newaxis] * shares[:, np.newaxis, :]
    return np.column_stack([places_m, wrapped(yaw_rad)]), known


def _smoothed_yaw(
    stamps_s: FloatArray, yaw_rad: FloatArray, variances: FloatArray, pieces: list[np.ndarray]
) -> tuple[FloatArray, FloatArray]:
    """Headings, and shares of their variances that are left."""
    told, stds = np.unwrap(yaw_rad), np.sqrt(variances)
    if not stds.all():
        return told, np.ones(len(told))
    parts = [_piece(_changes_of_rate(stamps_s[own]), told[own], stds[own], stds) for own in pieces]
    values, kept = _settled(_fit(parts))
    return values * stds, kept


def _smoothed_places(
    stamps_s: FloatArray,
    places_m: FloatArray,
    variances: FloatArray,
    yaw_rad: FloatArray,
    pieces: list[np.ndarray],
) -> tuple[FloatArray, FloatArray]:
    """Places, and shares of their variances that are left."""
    stds_m, middle_m = np.repeat(np.sqrt(variances), 2), places_m.mean(axis=0)
    told = (places_m - middle_m).ravel()

    def along(share: float | None) -> _Fit:
        parts = []
        for own in pieces:
            rows = _changes_of_velocity(stamps_s[own], _directions_rad(yaw_rad[own], share))
            both = np.stack([2 * own, 2 * own + 1], axis=1).ravel()
            parts.append(_piece(rows, told[both], stds_m[both], stds_m))
        return _fit(parts)

    values, kept = _settled(max(map(along, _ALONG), key=lambda fit: fit.noises.log_likelihood))
    return (values * stds_m).reshape(-1, 2) + middle_m, kept.reshape(-1, 2).mean(axis=1)


def _directions_rad(yaw_rad: FloatArray, share: float | None) -> FloatArray:
    """Along which axes steps from ping to ping are told, (n - 1,); the frame's own without one."""
    if share is None:
        return np.zeros(len(yaw_rad) - 1)
    return np.asarray((1.0 - share) * yaw_rad[:-1] + share * yaw_rad[1:])


def _steps(stamps_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times between pings over the usual one, and the roots of those between their middles."""
    steps_s = np.maximum(np.diff(stamps_s), _LEAST_S)
    steps = steps_s / np.median(steps_s)
    return steps, np.sqrt(0.5 * (steps[1:] + steps[:-1]))


def _changes_of_rate(stamps_s: FloatArray) -> FloatArray:
    """Rows that give the changes of a number's rate, over the root of their time."""
    steps, between = _steps(stamps_s)
    rates = np.diff(np.eye(len(stamps_s)), axis=0) / steps[:, np.newaxis]
    return np.asarray(np.diff(rates, axis=0) / between[:, np.newaxis])[:, np.newaxis, :]


def _changes_of_velocity(stamps_s: FloatArray, along_rad: FloatArray) -> FloatArray:
    """The same of velocities along given axes; unknowns are x and y of each ping in turn."""
    (steps, between), count = _steps(stamps_s), len(stamps_s)
    cosine, sine = np.cos(along_rad) / steps, np.sin(along_rad) / steps
    turn = np.array([[cosine, sine], [-sine, cosine]]).transpose(2, 0, 1)
    velocities, step = np.zeros((count - 1, 2, count, 2)), np.arange(count - 1)
    velocities[step, :, step + 1], velocities[step, :, step] = turn, -turn
    changes = np.diff(velocities, axis=0) / between[:, np.newaxis, np.newaxis, np.newaxis]
    return np.asarray(changes).reshape(count - 2, 2, 2 * count)


def _piece(rows: FloatArray, told: FloatArray, stds: FloatArray, all_stds: FloatArray) -> _Piece:
    return _Piece(rows * (stds / all_stds.mean()), told / stds)


def _spectrum(piece: _Piece, weights: FloatArray | float) -> _Spectrum:
    rows = piece.changes * np.sqrt(np.reshape(weights, (-1, 1, 1)))
    rows = rows.reshape(-1, rows.shape[-1])
    precisions, vectors = np.linalg.eigh(rows.T @ rows)
    # Of where a track begins, and how fast, the prior knows nothing.
    precisions[: rows.shape[1] - rows.shape[0]] = 0.0
    return _Spectrum(np.maximum(precisions, 0.0), vectors, vectors.T @ piece.told)


def _likeliest(spectra: Sequence[_Spectrum]) -> _Noises:
    """The noises of the grid by which what was told is likeliest."""
    precisions, told = (np.concatenate(values) for values in list(zip(*spectra, strict=True))[::2])
    is_known = precisions > 0.0
    slow = _CHANGES[:, np.newaxis] ** 2 / np.maximum(precisions[is_known], _TINY)
    variances = _SHARES[:, np.newaxis, np.newaxis] ** 2 + slow
    likely = -0.5 * (np.log(variances) + told[is_known] ** 2 / variances).sum(axis=-1)
    share, change = np.unravel_index(int(likely.argmax()), likely.shape)
    return _Noises(float(_SHARES[share]), float(_CHANGES[change]), float(likely[share, change]))


def _fit(pieces: list[_Piece], weights: Sequence[FloatArray | float] | None = None) -> _Fit:
    weights = [1.0] * len(pieces) if weights is None else weights
    spectra = [_spectrum(*both) for both in zip(pieces, weights, strict=True)]
    return _Fit(pieces, spectra, _likeliest(spectra))


def _settled(fit: _Fit) -> tuple[FloatArray, FloatArray]:
    """Unknowns over their standard deviations, and what is left of their variances."""
    before: FloatArray | float = np.inf
    for _ in range(_ROUNDS):
        pairs = zip(fit.pieces, fit.spectra, strict=True)
        weights = [_weights(piece, spectrum, fit.noises) for piece, spectrum in pairs]
        fit, all_weights = _fit(fit.pieces, weights), np.concatenate(weights)
        if np.abs(all_weights - before).max() < _SETTLED:
            break
        before = all_weights
    values = np.concatenate([each.likeliest(fit.noises) for each in fit.spectra])
    kept = np.concatenate([each.vectors**2 @ each.kept(fit.noises) for each in fit.spectra])
    # What wanders is not smoothed away.
    return values, 1.0 - fit.noises.white**2 * (1.0 - kept)


def _weights(piece: _Piece, spectrum: _Spectrum, noises: _Noises) -> FloatArray:
    """How far each change counts, (changes,): one that is far larger than usual hardly does."""
    changes = piece.changes @ spectrum.likeliest(noises)
    squares = (changes / noises.change) ** 2
    weights: FloatArray = (_FREEDOM + squares.shape[1]) / (_FREEDOM + squares.sum(axis=1))
    return weights
