"""Tiles of an area that one worker each maps."""

import math
from dataclasses import replace
from itertools import islice
from pathlib import Path
from unittest.mock import ANY

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usmap_ros.errors import UsmapError
from usmap_ros.grids import GridGeometry, OccupancyMap
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.mapping.merging import merge_maps
from usmap_ros.parameters import MappingParameters, PipelineParameters
from usmap_ros.runs.collection import AreaOptions, Collected, map_collection
from usmap_ros.runs.collection.tiles import Tile, tiles_of
from usmap_ros.simulation import Scenario, simulate

SCENARIO = Path(__file__).parents[4] / "config" / "scenarios" / "poles.yaml"
BOX_M = (-3.0, 2.0, 41.0, 11.5)

sides_m = st.floats(1.0, 60.0)


@given(sides_m, st.floats(-80.0, 80.0), st.floats(-80.0, 80.0))
def test_each_place_is_in_one_tile(side_m: float, x_m: float, y_m: float) -> None:
    assert sum(tile.holds(x_m, y_m) for tile in tiles_of(BOX_M, side_m)) == 1


@given(sides_m)
def test_no_side_is_longer_than_asked_for(side_m: float) -> None:
    tiles = tiles_of(BOX_M, side_m)
    sizes_m = [
        size_m
        for tile in tiles
        for size_m in (tile.east_m - tile.west_m, tile.north_m - tile.south_m)
        if math.isfinite(size_m)
    ]
    assert max(sizes_m, default=0.0) <= side_m * (1.0 + 1e-9)


def test_what_is_not_divided_is_one_tile() -> None:
    assert tiles_of(BOX_M, math.inf) == [Tile()]
    assert tiles_of(BOX_M, 44.0) == [Tile()]


@given(sides_m, st.sampled_from([0.02, 0.05, 0.1]), st.integers(-40, 40))
def test_maps_that_are_cut_join_to_what_they_were_cut_from(
    side_m: float, cell_m: float, first: int
) -> None:
    shape = (37, 61)
    rng = np.random.default_rng(1)
    geometry = GridGeometry(cell_m, (first * cell_m, -first * cell_m), shape)
    log_odds = rng.uniform(-2.0, 2.0, shape).astype(np.float32)
    whole = OccupancyMap(geometry, log_odds, rng.random(shape) < 0.5, "map", 1)
    box_m = (geometry.extent_m[0], geometry.extent_m[2], geometry.extent_m[1], geometry.extent_m[3])
    cuts = [tile.cut(whole) for tile in tiles_of(box_m, side_m * cell_m)]
    parts = [part for part in cuts if part is not None]
    assert sum(part.log_odds.size for part in parts) == log_odds.size
    joined = merge_maps(parts, MappingParameters())
    assert joined.geometry.shape == shape
    np.testing.assert_allclose(joined.log_odds, log_odds, atol=1e-5)
    np.testing.assert_array_equal(joined.observed, whole.observed)


def recorded(bag: Path, apart_m: tuple[float, float], pings: int) -> Path:
    """Record robots in two places that are so far apart."""
    heard = list(islice(simulate(Scenario.load(SCENARIO)), pings))
    with new_bag(bag) as writer:
        for place in (0, 1):
            for topic, trace in heard:
                position_m = trace.pose.position_m + place * np.array([*apart_m, 0.0])
                pose = replace(trace.pose, position_m=position_m)
                stamp_ns = trace.stamp_ns + place * 10**11
                writer.write_trace(topic, replace(trace, pose=pose, stamp_ns=stamp_ns))
    return bag


def collected(bag: Path, folder: Path, tile_m: float) -> Collected:
    """Map a recording in tiles."""
    options = AreaOptions(tile_m=tile_m)
    return map_collection([bag], folder, PipelineParameters(), wishes=options)


def test_an_area_in_tiles_has_the_same_walls_pings_and_ways(tmp_path: Path) -> None:
    row = recorded(tmp_path / "bag", (20.0, 0.0), 90)
    whole, tiled = (collected(row, tmp_path / "map", tile_m) for tile_m in (math.inf, 25.0))
    assert (whole.areas, whole.tiles, tiled.areas, tiled.tiles) == (1, 1, 1, 2)
    assert (tiled.run.pings, tiled.run.echoes) == (whole.run.pings, whole.run.echoes) == (180, ANY)
    assert tiled.paths == whole.paths
    assert tiled.summary(1.0)["tiles"] == 2
    geometry = GridGeometry.around([whole.occupancy.geometry, tiled.occupancy.geometry])
    walls = np.zeros((2, *geometry.shape), np.bool_)
    for own, done in zip(walls, (whole, tiled), strict=True):
        own[done.occupancy.geometry.within(geometry)] = done.occupancy.predicted()
    assert walls[0].sum() > 20
    assert (walls[0] != walls[1]).sum() <= 0.05 * walls[0].sum()


def test_tiles_that_no_ping_reaches_are_left_out(tmp_path: Path) -> None:
    corners = recorded(tmp_path / "bag", (40.0, 40.0), 12)
    tiled = collected(corners, tmp_path / "map", 20.0)
    assert (tiled.areas, tiled.run.pings, tiled.failed) == (1, 24, {})
    assert 2 <= tiled.tiles < 9


def test_cones_that_cannot_be_read_are_no_tiles_that_no_ping_reaches(tmp_path: Path) -> None:
    bag, folder = recorded(tmp_path / "bag", (40.0, 40.0), 12), tmp_path / "map"
    collected(bag, folder, 20.0)
    for kept in (folder / "cones").glob("*/*.mcap"):
        kept.write_bytes(b"not a recording")
    with pytest.raises(UsmapError, match="is not an MCAP file"):
        collected(bag, folder, 20.0)
