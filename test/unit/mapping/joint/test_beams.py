"""What is left out before it is looked at lies outside of beams; rays stop where sampling says."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.mapping.joint.visibility.beams import columns_in_beam, is_beside, rows_in_reach
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.mapping.joint.visibility.ray_casting import OPAQUE, RAYS, STEPS, WHOLE, cast_rays
from usmap_ros.mapping.ping_table import PingTable, ping_table_of
from usmap_ros.numerics.compiled import compiled
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

FIELD = Field(first_row=-62, first_column=-60, rows=125, columns=121, resolution_m=0.05)
#: Looks on the three functions from compiled code, as kernels call them.
bounds = compiled(lambda numbers, y_m: columns_in_beam(numbers, FIELD, y_m))
reach = compiled(lambda numbers: rows_in_reach(numbers, FIELD))
beside = compiled(lambda numbers, x_m, y_m: is_beside(numbers, x_m, y_m, 0.0))


@pytest.fixture(name="table", scope="module")
def looks_of_some(make_cone: Callable[..., EchoCone]) -> PingTable:
    """Give pings that look anywhere."""
    rng = np.random.default_rng(3)
    poses = [(*rng.uniform(-0.4, 0.4, 2), yaw) for yaw in rng.uniform(-math.pi, math.pi, 12)]
    cones = [make_cone(x_m=x, y_m=y, yaw_rad=yaw) for x, y, yaw in poses]
    return ping_table_of(cones, MappingParameters())


def test_cells_in_a_beam_are_between_its_bounds(table: PingTable) -> None:
    x_m, y_m = np.meshgrid(
        (FIELD.first_column + np.arange(FIELD.columns) + 0.5) * 0.05,
        (FIELD.first_row + np.arange(FIELD.rows) + 0.5) * 0.05,
    )
    for numbers in table.numbers:
        x, y = x_m - numbers[0], y_m - numbers[1]
        distance = np.hypot(x, y)
        is_inside = numbers[2] * x + numbers[3] * y > distance * numbers[8]
        rows, columns = np.nonzero(is_inside & (distance < numbers[10]))
        bottom, top = reach(numbers)
        assert ((rows >= bottom) & (rows < top)).all()
        left, right = np.array([bounds(numbers, y[row, 0]) for row in range(FIELD.rows)]).T
        assert ((columns >= left[rows]) & (columns < right[rows])).all()
        # A third of the circle, so not much more than the beam.
        assert (right - left)[bottom:top].sum() < 2.0 * len(rows)
        assert not any(beside(numbers, x[at], y[at]) for at in zip(rows, columns, strict=True))


def test_rays_end_where_all_their_samples_say(table: PingTable) -> None:
    depth = np.zeros(FIELD.shape, np.float32)
    rng = np.random.default_rng(4)
    depth[rng.integers(0, FIELD.rows, 150), rng.integers(0, FIELD.columns, 150)] = 1.5
    found = cast_rays(table, np.arange(len(table.bins)), FIELD, depth)
    for left, numbers in zip(found, table.numbers, strict=True):
        ray, step = np.arange(RAYS)[:, np.newaxis], np.arange(STEPS)
        angle = numbers[6] - numbers[7] + (ray + 0.5) * 2.0 * numbers[7] / RAYS
        away = (step + 0.5) * numbers[10] / STEPS / 0.05
        row = (numbers[1] / 0.05 - FIELD.first_row + away * np.sin(angle)).astype(int)
        column = (numbers[0] / 0.05 - FIELD.first_column + away * np.cos(angle)).astype(int)
        inside = (row >= 0) & (column >= 0) & (row < FIELD.rows) & (column < FIELD.columns)
        here = np.where(inside, depth[row * inside, column * inside], 0.0)
        passed = np.cumsum(here * numbers[10] / STEPS / 0.05, axis=1)
        passed = np.pad(passed, [(0, 0), (1, 0)])[:, :-1]
        expected = np.where(passed > OPAQUE, 0.0, np.floor(WHOLE * np.exp(-passed) + 0.5))
        assert (np.abs(left - expected) > 1.0).mean() < 1e-3
