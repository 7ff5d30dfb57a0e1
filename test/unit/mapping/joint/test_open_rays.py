"""Rays that end at nothing make mirrors as likely as anything else where that is unusual."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from usmap_ros.mapping.joint.free_space.open_rays import (
    MOST_OPEN,
    USUAL_OPEN,
    likely_as_anything,
    open_shares,
)
from usmap_ros.mapping.joint.free_space.response import HeardBins
from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.joint.visibility.field import field_around
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS, WHOLE, cast_rays
from usmap_ros.mapping.ping_bins import ECHO
from usmap_ros.mapping.ping_table import PingTable
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

RESOLUTION_M = 0.05
Pings = tuple[PingTable, NDArray[np.int64]]


@pytest.fixture
def pings(make_cone: Callable[..., EchoCone]) -> Pings:
    """Far apart, one that looks east and hears nothing; and two that look west, one hears a thing.

    These two are near each other.
    """
    kept = KeptPings(MappingParameters())
    kept.add(make_cone(x_m=3.0, stamp_ns=1), "robot")
    kept.add(make_cone((1.0, 0.3), yaw_rad=np.pi, stamp_ns=2), "robot")
    kept.add(make_cone(yaw_rad=np.pi, stamp_ns=3), "robot")
    table, rows, *_ = kept.pings()
    return table, rows


def listening_to(table: PingTable, rows: NDArray[np.int64], chance: float) -> HeardBins:
    """What was heard, every echo of it being so likely by what stands."""
    is_echo = table.kind[rows] == ECHO
    chances = np.where(is_echo, chance, 0.0).astype(np.float32)
    every, none = np.ones_like(chances), np.zeros(len(chances), np.int64)
    return HeardBins(is_echo.astype(np.uint8), chances, chances, every, none)


def test_rays_are_open_that_end_at_nothing_and_whose_ping_heard_nothing_unknown(
    pings: Pings,
) -> None:
    table, rows = pings
    left = np.full((len(rows), RAYS, STEPS), WHOLE, np.uint8)
    left[0, : RAYS // 4, 100:] = 0
    explained, unknown = (listening_to(table, rows, chance) for chance in (0.8, 0.1))
    assert open_shares(table, rows, left, explained) == pytest.approx([0.75, 1.0, 1.0])
    # From one place some ways may end, and others not.
    assert open_shares(table, rows, left, unknown) == pytest.approx([0.75, 0.5, 0.5])


def test_mirrors_are_as_likely_as_anything_where_rays_end_at_nothing(pings: Pings) -> None:
    table, rows = pings
    field = field_around(table, rows, RESOLUTION_M)
    left = np.full((len(rows), RAYS, STEPS), WHOLE, np.uint8)
    shares = np.array([1.0, 0.0, 0.0], np.float32)
    likely = likely_as_anything(table, rows, field, left, shares, USUAL_OPEN)
    assert likely.shape == field.shape
    east, west = (field.cells_at(np.array([x_m]), np.array([0.0])) for x_m in (4.5, -1.5))
    assert likely[east] == 1.0
    assert likely[west] == 0.0
    # Where that is usual, as in a hall, it says nothing.
    assert not likely_as_anything(table, rows, field, left, shares, MOST_OPEN).any()


def test_what_stands_ends_rays(pings: Pings) -> None:
    """Cells that no sound gets to say nothing of mirrors."""
    table, rows = pings
    field = field_around(table, rows, RESOLUTION_M)
    depth = np.zeros(field.shape, np.float32)
    wall_x_m = np.full(200, 4.0)
    depth[field.cells_at(wall_x_m, np.linspace(-3.0, 3.0, 200))] = 9.0
    left = cast_rays(table, rows, field, depth)
    nothing = listening_to(table, rows, 1.0)
    shares = open_shares(table, rows, left, nothing)
    assert shares == pytest.approx([0.0, 1.0, 1.0])
    shares[0] = 1.0
    likely = likely_as_anything(table, rows, field, left, shares, 0.0)
    behind = field.cells_at(np.array([5.0]), np.array([0.0]))
    assert likely[behind] == 0.0
