"""Scenes in which a few poles are heard by a few robots."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import Encoding
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import hear
from usmap_ros.simulation.receiver import Receiver

ROOT = Path(__file__).parents[2]
NOISE_STD = 0.01
#: Fainter echoes do not count as heard.
LEAST_AMPLITUDE = 0.03
#: Nearer in range, at any robot, two poles' echoes overlap.
LEAST_SEPARATION_M = 0.15


@pytest.fixture(scope="session")
def scenario_folder() -> Path:
    """Give the folder of the scenarios that come with the package."""
    return ROOT / "config" / "scenarios"


@dataclass(frozen=True)
class Sighting:
    """What the fused map of one ping from each robot says.

    Parameters
    ----------
    true_cells : (poles, 2) integer array
        Column and row of each pole, counted from the world's origin.
    cells : (cells, 2) integer array
        Of the map, likewise, the most probable first.
    probability : (cells,) array
        Of these.
    """

    true_cells: NDArray[np.int64]
    cells: NDArray[np.int64]
    probability: FloatArray

    def best(self, count: int, apart: int = 2) -> NDArray[np.int64]:
        """The most probable cells of which none is within `apart` cells of a better one."""
        chosen: list[NDArray[np.int64]] = []
        for cell in self.cells:
            if all(np.abs(cell - other).max() > apart for other in chosen):
                chosen.append(cell)
                if len(chosen) == count:
                    break
        return np.array(chosen)

    def are_right(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which cells are within one cell (Chebyshev) of a pole's."""
        return distance_cells(cells, self.true_cells) <= 1

    def are_found(self, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which poles have one of the cells within one cell of their own."""
        return distance_cells(self.true_cells, cells) <= 1


def distance_cells(of: NDArray[np.int64], to: NDArray[np.int64]) -> NDArray[np.int64]:
    """Chebyshev distance to the nearest of some cells; far if there are none."""
    away = np.abs(of[:, np.newaxis] - to).max(axis=2)
    return away.min(axis=1, initial=np.iinfo(np.int64).max)


@pytest.fixture(scope="session")
def look_at_poles() -> Callable[[int, int], Sighting]:
    """Give a function that makes a random scene of one to four poles and maps one ping a robot.

    Robots stand 1.5 m to 2.5 m from the middle and look past it by up to 0.2 rad: two of them with
    45° to 135° between, more of them all around.  Poles stand within 1.5 m of the middle in x and
    y, and each is heard by each robot, 15 cm nearer or farther than the others.
    """
    transducer = Transducer(
        Pulse(PulseShape.HANN_BURST, 50e3, 3.2e-4), BeamPattern.linear(), 0.2, 5.0
    )
    receiver = Receiver(Encoding.IQ, 25e3, 0.0, NOISE_STD)

    def are_heard(pose: Pose, points_m: FloatArray, strengths: FloatArray) -> bool:
        ranges_m, bearings = pose.polar(points_m)
        amplitudes = strengths * transducer.beam.gain(bearings) / ranges_m**2
        apart_m = np.diff(np.sort(ranges_m))
        return bool(
            np.all(amplitudes > LEAST_AMPLITUDE)
            and np.all(apart_m >= LEAST_SEPARATION_M)
            and np.all(ranges_m > transducer.min_range_m + 0.05)
        )

    def poses(robots: int, rng: np.random.Generator) -> list[Pose]:
        gap = rng.uniform(np.pi / 4, 3 * np.pi / 4) if robots == 2 else 2 * np.pi / robots
        angles = rng.uniform(0.0, 2 * np.pi) + gap * np.arange(robots)
        if robots > 2:
            angles += rng.uniform(-0.3, 0.3, robots)
        aside = rng.uniform(-0.2, 0.2, robots)
        distance_m = rng.uniform(1.5, 2.5, robots)
        return [
            Pose.planar(r * np.cos(a), r * np.sin(a), a + np.pi + off)
            for r, a, off in zip(distance_m, angles, aside, strict=True)
        ]

    def look(robots: int, seed: int) -> Sighting:
        rng = np.random.default_rng([seed, robots])
        places, count = poses(robots, rng), int(rng.integers(1, 5))
        while True:
            points_m = rng.uniform(-1.5, 1.5, (count, 2))
            strengths = np.exp(rng.normal(0.0, 0.35, count))
            if all(are_heard(pose, points_m, strengths) for pose in places):
                break
        pipeline = Pipeline()
        for pose in places:
            trace = hear(
                points_m, strengths, pose=pose, transducer=transducer, receiver=receiver, seed=rng
            )
            pipeline.process(trace)
        occupancy = pipeline.occupancy_map()
        resolution_m, probability = occupancy.geometry.resolution_m, occupancy.probability()
        order = np.argsort(-probability, axis=None, kind="stable")
        rows, columns = np.unravel_index(order, probability.shape)
        first = np.rint(np.array(occupancy.geometry.origin_m) / resolution_m).astype(np.int64)
        return Sighting(
            np.floor(points_m / resolution_m).astype(np.int64),
            np.column_stack([columns, rows]) + first,
            probability.ravel()[order],
        )

    return look
