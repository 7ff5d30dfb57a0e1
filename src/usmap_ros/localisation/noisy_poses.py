"""Poses that are absolute, but off by chance, each corrected by what its ping hears.

What is off is off anew at each ping, so that landmarks that many pings hear stand where they are
in the mean, and tell where each of the pings was: resection and intersection in turn, as in
photogrammetry (block coordinate descent of bundle adjustment: Triggs et al. 2000).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from usmap_ros.localisation.data_association import (
    ECHO_WEIGHT,
    DataAssociation,
    associate_echoes,
    cost_of_landmark,
)
from usmap_ros.localisation.echo_table import TrackEchoes, tabulate
from usmap_ros.localisation.found import FoundPoses
from usmap_ros.localisation.landmark_equations import changes_by_landmark, with_changes
from usmap_ros.localisation.lines_and_points import Landmarks
from usmap_ros.localisation.votes import find_landmarks
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import wrapped
from usmap_ros.pings.clutter import clutter_of, without_clutter
from usmap_ros.pings.cone import EchoCone

#: How far echoes may seem to be off landmarks, m, one after the other; and by how much landmarks
#: are found, at the least, or one would be found twice.
_SIGMAS_M, _FOUND_M = (0.04, 0.03, 0.03, 0.02, 0.02, 0.015), 0.03
#: Steps of landmarks and of poses for each of them.
_STEPS = 3
#: A line has so many times as many echoes as points have at the median.
_LINE_OVER_POINT = 1.5
#: What even the best poses are off, m and rad.
_FLOOR = 1e-3
#: How far a landmark's place, m, or direction, rad, may change at a time: its prior.
_MAY_MOVE = 0.3


def settle(cones: Sequence[EchoCone], told: FloatArray, known: FloatArray) -> FoundPoses | None:
    """Correct poses that are off by chance.

    Parameters
    ----------
    cones : sequence of EchoCone
        Of one frame, of any number of robots.
    told, known : (n, 3) and (n, 3, 3) arrays
        Where they are from: x, y (m) and yaw (rad), and how far these are off, as covariances.

    Returns
    -------
    FoundPoses or None
        None where poses as told explain what was heard as well.  Pings that hear nothing that
        others hear, too, stay where they were.
    """
    clutter = clutter_of(cones)
    echoes = tabulate([without_clutter(cone, clutter) for cone in cones], np.ones(len(cones)))
    if len(echoes.ping) == 0:
        return None
    information = np.asarray(np.linalg.inv(known + _FLOOR**2 * np.eye(3)))
    resection = _Resection(told, information, echoes)
    likely_as_told = resection.log_posterior()
    landmarks = Landmarks(np.zeros(0), np.zeros(0))
    for sigma_m in _SIGMAS_M:
        landmarks = resection.adjust(sigma_m)
    if resection.log_posterior() <= likely_as_told:
        return None
    # Of what stands, many pings that are off by themselves tell the place well.
    known = resection.covariances(landmarks, _SIGMAS_M[-1])
    return FoundPoses(resection.poses, known, known)


def without_chance_lines(landmarks: Landmarks, gathered: FloatArray) -> Landmarks:
    """Points, and those lines that gather clearly more echoes than points do.

    Lines of fewer are chance, and pings that are bent to one make walls among poles.

    Parameters
    ----------
    landmarks : Landmarks
        What seems to stand.
    gathered : (landmarks,) array
        How many echoes are of each.
    """
    is_kept, lines = np.ones(landmarks.total, bool), len(landmarks.normals_rad)
    if lines < landmarks.total:
        usual = float(np.median(gathered[lines:]))
        is_kept[:lines] = gathered[:lines] > _LINE_OVER_POINT * usual
    return landmarks.of(is_kept)


class _Resection:
    """Poses of pings from landmarks, and from what was told of each.

    Parameters
    ----------
    told : (pings, 3) array
        x, y (m) and yaw (rad).
    information : (pings, 3, 3) array
        How well they are known.
    echoes : TrackEchoes
        Of all pings.
    """

    def __init__(self, told: FloatArray, information: FloatArray, echoes: TrackEchoes) -> None:
        self._told, self._information, self.echoes = told, information, echoes
        self.poses = told.copy()
        self.all: BoolArray = np.ones(len(told), bool)

    def landmarks(self, sigma_m: float) -> Landmarks:
        """What stands, by where pings are now."""
        landmarks = find_landmarks(self.echoes, self.poses, self.all, sigma_m)
        heard = self.associate(landmarks, sigma_m)
        gathered = np.bincount(heard.landmark, heard.shares, landmarks.total)
        return without_chance_lines(landmarks, np.asarray(gathered))

    def log_posterior(self) -> float:
        """How likely poses are by what was told and by the landmarks that they show."""
        landmarks, moved = self.landmarks(_FOUND_M), self._moved()
        heard = self.associate(landmarks, _SIGMAS_M[-1])
        cost = landmarks.total * cost_of_landmark(len(moved))
        told = float(np.einsum("ni,nij,nj->", moved, self._information, moved))
        return ECHO_WEIGHT * heard.log_likelihood - cost - 0.5 * told

    def associate(self, landmarks: Landmarks, sigma_m: float) -> DataAssociation:
        """Which echoes are whose, from where pings are now."""
        return associate_echoes(self.echoes, self.poses, self.all, landmarks, sigma_m)

    def adjust(self, sigma_m: float) -> Landmarks:
        """Adjust poses and landmarks in turn; where these are then."""
        landmarks = self.landmarks(max(sigma_m, _FOUND_M))
        for _ in range(_STEPS):
            heard = self.associate(landmarks, sigma_m)
            landmarks = _intersected(landmarks, heard, _weights(heard, sigma_m))
            self._correct(landmarks, sigma_m)
        return landmarks

    def _correct(self, landmarks: Landmarks, sigma_m: float) -> None:
        """Move each ping to where what it hears and what was told of it are most likely."""
        heard = self.associate(landmarks, sigma_m)
        ping = self.echoes.ping[heard.echo]
        moved = self._moved()
        right = -np.einsum("nij,nj->ni", self._information, moved)
        pulls = _weights(heard, sigma_m) * heard.off_m * heard.by_pose
        right -= np.stack([np.bincount(ping, pull, len(moved)) for pull in pulls], axis=1)
        matrix = self._equations(heard, sigma_m)
        self.poses += np.linalg.solve(matrix, right[:, :, np.newaxis])[:, :, 0]
        self.poses[:, 2] = wrapped(self.poses[:, 2])

    def covariances(self, landmarks: Landmarks, sigma_m: float) -> FloatArray:
        """Of all poses, (pings, 3, 3), as far as it is known which echoes are whose."""
        heard = self.associate(landmarks, sigma_m)
        observed = heard.observed(self.echoes, landmarks.total, sigma_m)
        return np.asarray(np.linalg.inv(self._equations(observed, sigma_m)))

    def _moved(self) -> FloatArray:
        """By how much pings are elsewhere than told."""
        moved = self.poses - self._told
        moved[:, 2] = wrapped(moved[:, 2])
        return np.asarray(moved)

    def _equations(self, heard: DataAssociation, sigma_m: float) -> FloatArray:
        ping = self.echoes.ping[heard.echo]
        return self._information + _outer_sums(
            ping, heard.by_pose, _weights(heard, sigma_m), len(self.poses)
        )


def _weights(heard: DataAssociation, sigma_m: float) -> FloatArray:
    """Of what is heard of landmarks, per m²."""
    return np.asarray(ECHO_WEIGHT * heard.shares * heard.precision / sigma_m**2)


def _intersected(landmarks: Landmarks, heard: DataAssociation, weights: FloatArray) -> Landmarks:
    """Landmarks where echoes have them in the mean."""
    which = heard.landmark
    changes, middle_m = changes_by_landmark(landmarks, which, heard.along_m, heard.by_pose, weights)
    matrix = _outer_sums(which, changes, weights, landmarks.total) + _MAY_MOVE**-2 * np.eye(2)
    pulls = weights * heard.off_m * changes
    right = -np.stack([np.bincount(which, pull, landmarks.total) for pull in pulls], axis=1)
    moved = np.asarray(np.linalg.solve(matrix, right[:, :, np.newaxis])[:, :, 0])
    return with_changes(landmarks, moved, middle_m)


def _outer_sums(
    group: np.ndarray, vectors: FloatArray, weights: FloatArray, count: int
) -> FloatArray:
    """Weighted sums of the outer products of vectors, (k, n), by group: (count, k, k)."""
    size = len(vectors)
    sums = np.empty((count, size, size))
    for row in range(size):
        for column in range(size):
            products = weights * vectors[row] * vectors[column]
            sums[:, row, column] = np.bincount(group, products, count)
    return sums
