"""Which way surfaces face, from the cells that are believed and from where they were heard."""

from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.grids import NORMAL
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.normals import surface_normals
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

SIDE = 31


def normals_of(believed: np.ndarray, heard_from: tuple[float, float]) -> np.ndarray:
    heard = np.broadcast_to(heard_from, (*believed.shape, 2))
    return surface_normals(believed, np.ones(believed.shape), heard)


def line(angle_rad: float) -> np.ndarray:
    """Cells of a line through the middle."""
    believed = np.zeros((SIDE, SIDE), dtype=bool)
    along = np.arange(-12.0, 12.0, 0.25)
    rows, columns = (
        np.rint(SIDE // 2 + along * part).astype(int)
        for part in (np.sin(angle_rad), np.cos(angle_rad))
    )
    believed[rows, columns] = True
    return believed


@pytest.mark.parametrize("degrees", [0.0, 20.0, 45.0, 90.0, 120.0, 165.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_line_faces_those_who_heard_it(degrees: float, side: float) -> None:
    angle_rad = np.radians(degrees)
    normal = side * np.array([-np.sin(angle_rad), np.cos(angle_rad)])
    # From the side, but far from squarely.
    seen_from = normal + 1.5 * np.array([np.cos(angle_rad), np.sin(angle_rad)])
    believed = line(angle_rad)
    normal_rad = normals_of(believed, tuple(seen_from))
    assert np.array_equal(np.isfinite(normal_rad), believed)
    cosine = np.cos(normal_rad[believed] - np.arctan2(normal[1], normal[0]))
    assert cosine.min() > np.cos(np.radians(15.0))


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 3), (2, 2), (3, 3), (3, 4)])
def test_a_pole_has_no_normal(height: int, width: int) -> None:
    believed = np.zeros((SIDE, SIDE), dtype=bool)
    believed[10 : 10 + height, 10 : 10 + width] = True
    assert np.isnan(normals_of(believed, (1.0, 0.5))).all()


def test_poles_in_a_row_make_no_line() -> None:
    believed = np.zeros((SIDE, SIDE), dtype=bool)
    believed[10, ::2] = True
    assert np.isnan(normals_of(believed, (0.0, 1.0))).all()


def test_a_line_that_nobody_heard_from_a_side_has_no_normal() -> None:
    assert np.isnan(normals_of(line(0.0), (0.0, 0.0))).all()


def test_both_faces_of_a_corner_are_told() -> None:
    believed = np.zeros((SIDE, SIDE), dtype=bool)
    believed[5, 5:25] = believed[5:25, 5] = True
    normal_rad = normals_of(believed, (1.0, 1.0))
    np.testing.assert_allclose(normal_rad[5, 9:25], np.pi / 2.0, atol=1e-6)
    np.testing.assert_allclose(normal_rad[9:25, 5], 0.0, atol=1e-6)


def test_nothing_believed_gives_no_normals() -> None:
    assert np.isnan(normals_of(np.zeros((4, 5), dtype=bool), (1.0, 0.0))).all()


@pytest.fixture(scope="module")
def wall(cone_of_objects: Callable[..., EchoCone]) -> JointFusion:
    """Give a map of a short dense row of scatterers at x = 1.5 m, heard from the left."""
    fusion = JointFusion(MappingParameters())
    row = [(1.525, y_m, 0.5) for y_m in np.arange(-0.275, 0.3, 0.05)]
    for number, y_m in enumerate(np.linspace(-1.4, 1.4, 15)):
        yaw_rad = float(np.arctan2(-y_m, 1.5))
        for x_m in (0.0, 0.3, 0.6):
            fusion.fuse(
                cone_of_objects(*row, x_m=x_m, y_m=float(y_m), yaw_rad=yaw_rad, stamp_ns=number)
            )
    return fusion


def test_the_map_of_a_wall_tells_which_way_it_faces(wall: JointFusion) -> None:
    occupancy = wall.occupancy_map()
    normal_rad = occupancy.layers[NORMAL]
    assert normal_rad.dtype == np.float32
    assert normal_rad.shape == occupancy.geometry.shape
    known = np.isfinite(normal_rad)
    assert known.sum() >= 4
    assert not (known & ~occupancy.predicted()).any()
    assert np.cos(normal_rad[known] - np.pi).min() > np.cos(np.radians(30.0))


def test_a_resumed_map_still_knows_which_way_its_walls_face(wall: JointFusion) -> None:
    before = wall.occupancy_map()
    resumed = JointFusion(MappingParameters())
    resumed.resume(before)
    after = resumed.occupancy_map()
    assert after.geometry == before.geometry
    np.testing.assert_array_equal(
        np.isfinite(after.layers[NORMAL]), np.isfinite(before.layers[NORMAL])
    )
    np.testing.assert_allclose(after.layers[NORMAL], before.layers[NORMAL], atol=0.05)


def test_cells_are_looked_at_by_the_thousand(monkeypatch: pytest.MonkeyPatch) -> None:
    believed = line(np.radians(20.0)) | line(np.radians(90.0))
    at_once = normals_of(believed, (1.0, 0.5))
    monkeypatch.setattr("usmap_ros.mapping.normals._AT_ONCE", 7)
    np.testing.assert_allclose(normals_of(believed, (1.0, 0.5)), at_once, atol=1e-6)
