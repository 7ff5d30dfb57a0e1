"""Landmarks are eliminated as a solution of all unknowns together would have it."""

import numpy as np

from usmap_ros.localisation.arcs import Pulls
from usmap_ros.localisation.echo_table import Echoes
from usmap_ros.localisation.landmarks import _FREEDOM, Equations, Knots, eliminate


def test_eliminated_landmarks_leave_the_same_poses() -> None:
    rng = np.random.default_rng(6)
    poses = np.column_stack([rng.uniform(-1.0, 1.0, (6, 2)), np.zeros(6)])
    places = np.array([[2.0, 0.5], [1.5, -1.0], [-2.0, 1.0]])
    echo = np.arange(18)
    ping, cell = echo // 3, echo % 3
    ranges_m = np.linalg.norm(places[cell] - poses[ping, :2], axis=1) + 0.02 * rng.normal(size=18)
    along = places[cell] - poses[ping, :2]
    seen = (
        poses[ping, :2]
        + along / np.linalg.norm(along, axis=1, keepdims=True) * (ranges_m[:, np.newaxis])
    )
    weight = rng.uniform(0.2, 1.0, 18)
    ones = np.ones(18)
    echoes = Echoes(ping, ranges_m, 0.7 * ones, 0.0 * ones, 1e6 * ones, ones, 0.0 * ones)
    pulls = Pulls(echo, cell, weight, seen[:, 0].copy(), seen[:, 1].copy())
    # Three knots: the pings between them, and one that is fixed.
    knots = Knots(np.array([0, 0, 1, 1, 1, -1]), np.array([0.0, 0.4, 0.0, 0.6, 1.0, 0.0]))
    sigma_m, matrix, right = 0.05, np.zeros((9, 9)), np.zeros(9)
    order = np.argsort(cell, kind="stable")
    eliminate(pulls, order, echoes, poses, knots, Equations(matrix, right, sigma_m))
    prior = 100.0 * np.eye(9)
    expected = _together(pulls, echoes, poses, knots, sigma_m, prior)
    np.testing.assert_allclose(np.linalg.solve(matrix + prior, right), expected, rtol=1e-6)


def _together(
    pulls: Pulls, echoes: Echoes, poses: np.ndarray, knots: Knots, sigma_m: float, prior: np.ndarray
) -> np.ndarray:
    """Changes of the knots, by the normal equations of knots and landmarks."""
    count = 9 + 6
    full, side = np.zeros((count, count)), np.zeros(count)
    full[:9, :9] = prior
    full[9:, 9:] = np.eye(6) / (_FREEDOM * sigma_m) ** 2
    for row, cell in enumerate(pulls.cell):
        mine = pulls.cell == cell
        total = pulls.weight[mine].sum()
        landmark = np.array([pulls.x_m[mine], pulls.y_m[mine]]) @ pulls.weight[mine] / total
        ping = echoes.ping[pulls.echo[row]]
        offset = landmark - poses[ping, :2]
        distance = np.linalg.norm(offset)
        jacobian = np.zeros(count)
        jacobian[9 + 2 * cell : 11 + 2 * cell] = offset / distance
        if knots.before[ping] >= 0:
            for side_of, part in ((0, 1.0 - knots.share[ping]), (1, knots.share[ping])):
                at = 3 * min(int(knots.before[ping]) + side_of, 2)
                jacobian[at : at + 2] -= part * offset / distance
        weight = pulls.weight[row] / sigma_m**2
        full += weight * np.outer(jacobian, jacobian)
        side -= weight * jacobian * (distance - echoes.range_m[pulls.echo[row]])
    return np.linalg.solve(full, side)[:9]
