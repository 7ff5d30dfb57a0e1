"""Walls and points are eliminated as a solution of all unknowns together would have it."""

import numpy as np

from usmap_ros.localisation.data_association import DataAssociation
from usmap_ros.localisation.echo_table import TrackEchoes
from usmap_ros.localisation.landmark_equations import Knots, LandmarkEquations
from usmap_ros.localisation.lines_and_points import Landmarks, view_landmarks
from usmap_ros.localisation.square_walls import Squareness

#: Two walls and two points.
PLACES = Landmarks(np.array([0.3, 1.8]), np.array([2.5, 3.0]), np.array([[2.0, 0.5], [1.0, 2.5]]))


def errors(ranges_m: np.ndarray, places: Landmarks, poses: np.ndarray) -> np.ndarray:
    """By how much ranges are too long, one to each place from each pose."""
    ones = np.ones(len(poses))
    echoes = TrackEchoes(
        np.arange(len(poses)), ones, 3.3 * ones, 0.0 * ones, ones, ones, 0.0 * ones, ones
    )
    return np.asarray(ranges_m - view_landmarks(places, echoes, poses).far_m).ravel()


def test_eliminated_landmarks_leave_the_same_poses() -> None:
    rng = np.random.default_rng(6)
    poses = np.column_stack([rng.uniform(-1.0, 1.0, (6, 2)), np.zeros(6)])
    # Three knots: the pings between them, and one that is fixed.
    knots = Knots(np.array([0, 0, 1, 1, 1, -1]), np.array([0.0, 0.4, 0.0, 0.6, 1.0, 0.0]))
    ranges_m = 2.0 + 0.02 * rng.normal(size=(6, 4))
    echo, ones = np.arange(24), np.ones(24)
    ping, landmark = echo // 4, echo % 4
    echoes = TrackEchoes(ping, ranges_m.ravel(), ones, 0.0 * ones, ones, ones, 0.0 * ones, ones)

    def moved(change: np.ndarray) -> tuple[np.ndarray, Landmarks]:
        at, places = change[:9].reshape(3, 3), change[9:].reshape(4, 2)
        after = np.minimum(knots.before + 1, 2)
        share = knots.share[:, np.newaxis]
        shift = (1.0 - share) * at[knots.before] + share * at[after]
        shift[knots.before < 0] = 0.0
        lines = PLACES.normals_rad + places[:2, 0], PLACES.distances_m + places[:2, 1]
        return poses + shift, Landmarks(*lines, PLACES.points_m + places[2:])

    def off_m(change: np.ndarray) -> np.ndarray:
        there, places = moved(change)
        return errors(ranges_m, places, there)

    weights, step, start = rng.uniform(0.2, 1.0, 24), 1e-6, off_m(np.zeros(17))
    slopes = np.stack([(off_m(step * one) - off_m(-step * one)) for one in np.eye(17)], axis=1)
    slopes /= 2.0 * step
    seen = view_landmarks(PLACES, echoes, poses)
    by_pose = np.stack([seen.toward_x.ravel(), seen.toward_y.ravel(), np.zeros(24)])
    along_m = seen.along_m.ravel()
    heard = DataAssociation(echo, landmark, ones, start, along_m, by_pose, weights, 0.0)
    square = Squareness(np.array([0.9, 0.6]), np.array([0.02, -0.01]), 0.02, 1.0)
    equations = LandmarkEquations(PLACES, heard, echoes, poses, knots, 3, 7.0, square)
    matrix, right = 100.0 * np.eye(9), np.zeros(9)
    equations.add(matrix, right)
    change = np.linalg.solve(matrix, right)

    # What is known beforehand: knots as here; walls turn about the middle of what was heard.
    known = np.diag([100.0] * 9 + [0.0] * 8)
    for wall in range(2):
        mine = landmark == wall
        middle_m = float(weights[mine] @ along_m[mine] / weights[mine].sum())
        turn, move = 9 + 2 * wall, 10 + 2 * wall
        # The wall's distance at its middle is what may move.
        row = np.zeros(17)
        row[move], row[turn] = 1.0, -middle_m
        known += np.outer(row, row) / 0.3**2
        known[turn, turn] += 1.0 / 0.2**2
    known[13:, 13:] += np.eye(4) / 0.3**2
    # Both walls keep to a direction that is an unknown, too: what they differ by is known.
    apart = np.eye(17)[9] - np.eye(17)[11]
    information = 1.0 / (1.0 / 0.9 + 1.0 / 0.6) / 0.02**2
    known += information * np.outer(apart, apart)
    full = known + 7.0 * slopes.T @ (weights[:, np.newaxis] * slopes)
    pull = -7.0 * slopes.T @ (weights * start) - information * 0.03 * apart
    together = np.linalg.solve(full, pull)
    np.testing.assert_allclose(change, together[:9], rtol=1e-4, atol=1e-8)
    places = equations.moved(change.reshape(3, 3))
    np.testing.assert_allclose(places.points_m, PLACES.points_m + together[13:].reshape(2, 2),
                               rtol=1e-4, atol=1e-8)  # fmt: skip
    lines = np.stack([places.normals_rad, places.distances_m], axis=1)
    before = np.stack([PLACES.normals_rad, PLACES.distances_m], axis=1)
    np.testing.assert_allclose(lines - before, together[9:13].reshape(2, 2), rtol=1e-4, atol=1e-8)
