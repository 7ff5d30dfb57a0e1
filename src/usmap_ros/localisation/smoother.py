"""Poses of all pings together with what they hear."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from usmap_ros.localisation.data_association import (
    ECHO_WEIGHT,
    DataAssociation,
    associate_echoes,
    cost_of_landmark,
)
from usmap_ros.localisation.echo_table import TrackEchoes
from usmap_ros.localisation.equations import (
    ScaleEquation,
    add_chain,
    covariances,
    found_spread,
    log_information,
    odometry_cost,
    solve,
)
from usmap_ros.localisation.landmark_equations import Knots, LandmarkEquations, line_directions
from usmap_ros.localisation.lines_and_points import Landmarks
from usmap_ros.localisation.planar import compose
from usmap_ros.localisation.square_walls import Squareness, squareness
from usmap_ros.localisation.tracks import Track
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import wrapped

#: Knots are not moved farther at once, m.
_LARGEST_STEP_M = 0.3


class KnotCovariances(NamedTuple):
    """How well knots are known."""

    #: (knots, 3, 3) array: in the frame, in which landmarks may be off as well.
    in_frame: FloatArray
    #: (knots, 3, 3) array: against the landmarks.
    to_landmarks: FloatArray


class Smoother:
    """Poses of tracks, and what all of them hear.

    Parameters
    ----------
    tracks : sequence of Track
        Of the robots.
    echoes : TrackEchoes
        Of all pings.
    """

    def __init__(self, tracks: Sequence[Track], echoes: TrackEchoes) -> None:
        self.tracks, self.echoes = list(tracks), echoes
        self.poses = np.zeros((sum(len(track.rows) for track in tracks), 3))
        for track in tracks:
            self.poses[track.rows] = track.told
        self.knots = [track.told[track.knots].copy() for track in tracks]
        self._free = [number for number, track in enumerate(tracks) if not track.is_fixed]
        self._number_knots()
        self.active = np.zeros(len(self.poses), np.bool_)

    def _number_knots(self) -> None:
        """Number the knots of all tracks that may move, and find each ping's."""
        self.knot = np.full(len(self.poses), -1, np.int64)
        self.share, self.first = np.zeros(len(self.poses)), {}
        count = 0
        for number in self._free:
            track = self.tracks[number]
            before, share = track.shares()
            self.first[number] = count
            self.knot[track.rows], self.share[track.rows] = count + before, share
            count += len(track.knots)
        self.knot_count = count

    def begin_with(self, poses: FloatArray) -> None:
        """Let tracks that may move have other poses than they were told, (n, 3)."""
        for number in self._free:
            track = self.tracks[number]
            self.knots[number] = poses[track.rows[track.knots]]
        self.spread()

    def log_posterior_of(self, landmarks: Landmarks, sigma_m: float) -> float:
        """How likely poses are by odometry and landmarks, less what these cost.

        Relative to no echo being a landmark's.
        """
        heard = associate_echoes(self.echoes, self.poses, self.active, landmarks, sigma_m)
        cost = landmarks.total * cost_of_landmark(int(self.active.sum()))
        square = self._squareness(landmarks, heard, sigma_m).gain
        return ECHO_WEIGHT * heard.log_likelihood + square - cost - 0.5 * self._odometry_cost()

    def _squareness(
        self, landmarks: Landmarks, heard: DataAssociation, sigma_m: float
    ) -> Squareness:
        """How the lines of landmarks keep to one direction."""
        told = line_directions(landmarks, heard, self.echoes, ECHO_WEIGHT / sigma_m**2)
        return squareness(landmarks.normals_rad, *told, sigma_m)

    def _odometry_cost(self) -> float:
        return sum(odometry_cost(self.tracks[n], self.knots[n]) for n in self._free)

    def spread(self) -> None:
        """Bring all poses in line with the knots, and the scales of odometry."""
        for number in self._free:
            track = self.tracks[number]
            ScaleEquation.of(track, self.knots[number]).fit(track)
            self.poses[track.rows] = track.poses(self.knots[number])

    def adjust_to(
        self, landmarks: Landmarks, sigma_m: float
    ) -> tuple[Landmarks, tuple[FloatArray, bool]]:
        """Improve all knots and landmarks together, by a Gauss-Newton step.

        Returns
        -------
        Landmarks
            Where they are then.
        factor
            Decomposition for `covariances`.
        """
        heard = associate_echoes(self.echoes, self.poses, self.active, landmarks, sigma_m)
        equations, *both = self._equations(landmarks, heard, sigma_m)
        change, factor = solve(*both)
        farthest_m = float(np.abs(change[:, :2]).max(initial=0.0))
        change *= min(1.0, _LARGEST_STEP_M / max(farthest_m, 1e-9))
        self.move(change)
        return equations.moved(change), factor

    def known_by(self, landmarks: Landmarks, sigma_m: float) -> KnotCovariances:
        """How well all knots are known by echoes of landmarks that stand so."""
        heard = associate_echoes(self.echoes, self.poses, self.active, landmarks, sigma_m)
        observed = heard.observed(self.echoes, landmarks.total, sigma_m)
        equations, matrix, right = self._equations(landmarks, observed, sigma_m)
        both = matrix, equations.as_landmarks_stand(matrix)
        return KnotCovariances(
            *(covariances(solve(one, right)[1], self.knot_count) for one in both)
        )

    def _equations(
        self, landmarks: Landmarks, heard: DataAssociation, sigma_m: float
    ) -> tuple[LandmarkEquations, FloatArray, FloatArray]:
        """Equations of landmarks, and both sides of those of the knots, odometry among them."""
        equations = LandmarkEquations(
            landmarks, heard, self.echoes, self.poses, Knots(self.knot, self.share),
            self.knot_count, ECHO_WEIGHT / sigma_m**2, self._squareness(landmarks, heard, sigma_m),
        )  # fmt: skip
        size = 3 * self.knot_count
        matrix, right = np.zeros((size, size)), np.zeros(size)
        equations.add(matrix, right)
        for number in self._free:
            self._add_odometry(number, matrix, right)
        return equations, matrix, right

    def weigh_odometry(self, factor: tuple[FloatArray, bool]) -> None:
        """Find out how well the odometry of each robot is known, by how far echoes have it off.

        Parameters
        ----------
        factor
            Decomposition of the last adjustment.
        """
        for number, first in self.first.items():
            track, knots = self.tracks[number], self.knots[number]
            if len(knots) > 1:
                known = covariances(factor, len(knots) - 1, first, together=2)
                track.spread = found_spread(track, knots, known)

    def left_open(self, factor: tuple[FloatArray, bool]) -> float:
        """Occam's factor: how much narrower echoes make what odometry left open, as a logarithm.

        Parameters
        ----------
        factor
            Decomposition of the last adjustment.
        """
        narrowed = float(np.log(np.diagonal(factor[0])).sum())
        return narrowed - sum(log_information(self.tracks[number]) for number in self._free)

    def _add_odometry(self, number: int, matrix: FloatArray, right: FloatArray) -> None:
        track, knots, first = self.tracks[number], self.knots[number], 3 * self.first[number]
        add_chain(track, knots, matrix, right, first)
        own = slice(first, first + 3 * len(knots))
        scale = ScaleEquation.of(track, knots)
        scale.eliminate(matrix[own, own], right[own])

    def move(self, change: FloatArray) -> None:
        """Change all knots that may move."""
        for number in self._free:
            first = self.first[number]
            knots = self.knots[number]
            knots += change[first : first + len(knots)]
            knots[:, 2] = wrapped(knots[:, 2])
        self.spread()

    def predict(self, number: int, knot: int) -> None:
        """Let the knots behind one follow odometry from it."""
        track, knots = self.tracks[number], self.knots[number]
        for at in range(knot, len(knots) - 1):
            knots[at + 1] = compose(knots[at], track.increments[at])
