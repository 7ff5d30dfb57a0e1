"""Robots that go all over a scene, from place to place along ways that are free.

One that wanders often stays in the room where it began, and robots of different rooms share
nothing that their maps could be joined by.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from usmap_ros.simulation import Scenario

FloatArray = NDArray[np.float64]
#: Room around a robot, m; places that ways lead by, and the longest leg between two of them, m.
ROOM_M, PLACES, LEG_M = 0.3, 120, 1.5


def tours(scene: Scenario, seed: int) -> list[dict[str, Any]]:
    """Motions of a scene's robots, each from one place drawn at random to the next.

    Parameters
    ----------
    scene : Scenario
        With robots that wander.
    seed : int
        Of the places.
    """
    rng = np.random.default_rng([seed, *b"tour"])
    places_m, legs_m = roads(scene, rng)
    return [
        {
            "kind": "waypoints",
            "waypoints_m": places_m[tour(legs_m, speed_m_s * scene.duration_s, rng)].tolist(),
            "loop": False,
            "speed_m_s": speed_m_s,
            "clearance_m": ROOM_M,
        }
        for speed_m_s in (robot.motion.speed_m_s for robot in scene.robots)
    ]


def roads(scenario: Scenario, rng: np.random.Generator) -> tuple[FloatArray, csr_matrix]:
    """Places that can all be reached from each other, and the lengths of free legs, m."""
    scene, geometry = scenario.scene(), scenario.truth_map().geometry
    low = np.array(geometry.origin_m)
    high = low + geometry.resolution_m * np.array(geometry.shape[::-1])
    drawn: list[FloatArray] = []
    while len(drawn) < PLACES:
        place_m = rng.uniform(low, high)
        if scene.has_room(place_m, ROOM_M):
            drawn.append(place_m)
    places_m = np.array(drawn)
    apart_m = np.hypot(*(places_m[:, np.newaxis] - places_m).T)
    for one, other in zip(*np.nonzero(apart_m <= LEG_M), strict=True):
        if scene.clearance_m(places_m[one], places_m[other]) < ROOM_M:
            apart_m[one, other] = np.inf
    legs_m = csr_matrix(np.where(apart_m <= LEG_M, apart_m, 0.0))
    _, part = connected_components(legs_m)
    kept = np.flatnonzero(part == np.bincount(part).argmax())
    return places_m[kept], legs_m[kept][:, kept]


def tour(legs_m: csr_matrix, way_m: float, rng: np.random.Generator) -> list[int]:
    """Places that a robot comes by on a way of that length, or a little longer."""
    far_m, before = dijkstra(legs_m, return_predecessors=True)
    way, gone_m = [int(rng.integers(len(far_m)))], 0.0
    while gone_m < way_m:
        start, at = way[-1], int(rng.integers(len(far_m)))
        gone_m += float(far_m[start, at])
        back: list[int] = []
        while at != start:
            back.append(at)
            at = int(before[start, at])
        way += back[::-1]
    return way
