"""Whatever a map holds, saving it and loading it again changes nothing."""

import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from usmap_ros.grids import FREE_VALUE, OCCUPIED_VALUE, GridGeometry, OccupancyMap
from usmap_ros.io.map_files import load_map, load_truth, save_map
from usmap_ros.io.nav2_map import load_nav2_map
from usmap_ros.pings.robot_paths import RobotPaths


@st.composite
def maps(draw: st.DrawFn) -> OccupancyMap:
    shape = draw(array_shapes(min_dims=2, max_dims=2, max_side=12))
    resolution_m = draw(st.floats(0.005, 2.0))
    corner = draw(st.tuples(st.integers(-1000, 1000), st.integers(-1000, 1000)))
    return OccupancyMap(
        GridGeometry(resolution_m, (corner[0] * resolution_m, corner[1] * resolution_m), shape),
        draw(arrays(np.float32, shape, elements=st.floats(-20, 20, width=32))),
        draw(arrays(np.bool_, shape)),
        draw(st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=10)),
        draw(st.integers(0, 2**62)),
    )


coordinates = st.floats(-1e3, 1e3, width=32)
robot_paths = st.dictionaries(
    st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=10),
    st.lists(st.tuples(coordinates, coordinates), max_size=5),
    max_size=4,
).map(RobotPaths)


@given(maps(), robot_paths)
def test_a_map_survives_saving(occupancy: OccupancyMap, paths: RobotPaths) -> None:
    with tempfile.TemporaryDirectory() as folder:
        save_map(Path(folder), occupancy, paths)
        loaded, loaded_paths = load_map(Path(folder))
        values = load_nav2_map(Path(folder) / "map.yaml")
        truth = load_truth(Path(folder) / "map.yaml")
    assert loaded.geometry == values.geometry == occupancy.geometry
    assert (loaded.frame_id, loaded.stamp_ns) == (occupancy.frame_id, occupancy.stamp_ns)
    np.testing.assert_array_equal(loaded.log_odds, occupancy.log_odds)
    np.testing.assert_array_equal(loaded.observed, occupancy.observed)
    assert loaded_paths == paths

    trinary = occupancy.trinary()
    np.testing.assert_array_equal(values.probability == 1.0, trinary == OCCUPIED_VALUE)
    np.testing.assert_array_equal(values.probability == 0.0, trinary == FREE_VALUE)
    np.testing.assert_array_equal(truth.occupied, trinary == OCCUPIED_VALUE)
