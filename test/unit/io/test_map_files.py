import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from usmap_ros.errors import MapFileError
from usmap_ros.grids import NORMAL, GridGeometry, OccupancyMap, TruthMap
from usmap_ros.io.map_files import load_map, load_truth, map_folder, save_map, save_truth
from usmap_ros.io.nav2_map import load_nav2_map
from usmap_ros.pings.fields_of_view import Beam
from usmap_ros.pings.robot_paths import RobotPaths


@pytest.fixture
def occupancy() -> OccupancyMap:
    log_odds = np.array([[-4.0, 4.0, 0.0], [-1.0, -4.0, -4.0]], dtype=np.float32)
    observed = np.array([[True, True, True], [False, True, True]])
    geometry = GridGeometry(0.05, (-1.0, 2.0), (2, 3))
    return OccupancyMap(geometry, log_odds, observed, "map", stamp_ns=5)


def test_a_map_survives_saving(occupancy: OccupancyMap, tmp_path: Path) -> None:
    paths = RobotPaths({"/b": [(0.0, 1.0), (2.0, 3.0)]})
    paths.add("/a", 4.0, 5.0, Beam(-0.5, 0.75, 5.0))
    save_map(tmp_path, occupancy, paths)
    loaded, loaded_paths = load_map(tmp_path)
    assert loaded.geometry == occupancy.geometry
    np.testing.assert_array_equal(loaded.log_odds, occupancy.log_odds)
    np.testing.assert_array_equal(loaded.observed, occupancy.observed)
    assert (loaded.frame_id, loaded.stamp_ns) == ("map", 5)
    assert loaded_paths == paths


def test_layers_survive_saving(occupancy: OccupancyMap, tmp_path: Path) -> None:
    normal_rad = np.array([[np.nan, 1.5, np.nan], [0.0, np.nan, -3.0]], dtype=np.float32)
    save_map(tmp_path, replace(occupancy, layers={NORMAL: normal_rad}))
    loaded, _ = load_map(tmp_path)
    assert list(loaded.layers) == [NORMAL]
    np.testing.assert_array_equal(loaded.layers[NORMAL], normal_rad)


def test_a_layer_that_does_not_fit_is_refused(occupancy: OccupancyMap, tmp_path: Path) -> None:
    save_map(tmp_path, replace(occupancy, layers={NORMAL: np.zeros((3, 2), np.float32)}))
    with pytest.raises(MapFileError, match=r"log_odds is \(2, 3\) and normal_rad \(3, 2\)"):
        load_map(tmp_path)


def test_a_layer_of_numbers_that_cannot_be_is_refused(
    occupancy: OccupancyMap, tmp_path: Path
) -> None:
    normal_rad = np.array([[np.nan, 1.5, np.inf], [0.0, np.nan, -3.0]], dtype=np.float32)
    save_map(tmp_path, replace(occupancy, layers={NORMAL: normal_rad}))
    with pytest.raises(MapFileError, match="normal_rad is up to inf"):
        load_map(tmp_path)


def test_views_need_every_beam_or_a_range() -> None:
    paths = RobotPaths({"/b": [(0.0, 1.0)]})
    paths.add("/a", 4.0, 5.0, Beam(-0.5, 0.75, 5.0))
    assert paths.views() is None
    assert RobotPaths().views(3.0) is None
    views = paths.views(3.0)
    assert views is not None
    assert views.positions_m.tolist() == [[0.0, 1.0], [4.0, 5.0]]
    assert views.beams.tolist() == [[0.0, np.pi, 3.0], [-0.5, 0.75, 5.0]]


def test_paths_without_beams_are_read(occupancy: OccupancyMap, tmp_path: Path) -> None:
    save_map(tmp_path, occupancy, RobotPaths({"/b": [(0.0, 1.0), (2.0, 3.0)]}))
    arrays = dict(np.load(tmp_path / "map.npz"))
    del arrays["path_beams"]
    np.savez(tmp_path / "map.npz", **arrays)
    _, paths = load_map(tmp_path)
    assert np.isnan(paths.beams["/b"]).tolist() == [[True] * 3] * 2


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"path_positions": np.full((1, 2), np.inf)}, "path_positions is not finite everywhere"),
        ({"path_beams": np.zeros((2, 3))}, r"path_positions is \(1, 2\) and path_beams \(2, 3\)"),
    ],
)
def test_paths_that_cannot_be(
    occupancy: OccupancyMap, tmp_path: Path, changes: dict[str, np.ndarray], cause: str
) -> None:
    save_map(tmp_path, occupancy, RobotPaths({"/b": [(0.0, 1.0)]}))
    np.savez(tmp_path / "map.npz", **{**np.load(tmp_path / "map.npz"), **changes})
    with pytest.raises(MapFileError, match=cause):
        load_map(tmp_path)


def test_the_contracts_arrays(occupancy: OccupancyMap, tmp_path: Path) -> None:
    save_map(tmp_path, occupancy)
    with np.load(tmp_path / "map.npz") as arrays:
        assert arrays["log_odds"].dtype == np.float32
        assert arrays["log_odds"].shape == (2, 3)
        assert arrays["observed"].dtype == np.bool_
        assert float(arrays["resolution"]) == 0.05
        assert arrays["origin"].tolist() == [-1.0, 2.0]
        assert str(arrays["frame_id"]) == "map"


def test_nav2_reads_the_map_as_it_is_meant(occupancy: OccupancyMap, tmp_path: Path) -> None:
    save_map(tmp_path, occupancy)
    description = yaml.safe_load((tmp_path / "map.yaml").read_text())
    assert description["mode"] == "trinary"
    assert description["origin"] == [-1.0, 2.0, 0.0]
    # The lowest row of cells is the last of the image.
    pixels = np.asarray(Image.open(tmp_path / "map.pgm"))
    np.testing.assert_array_equal(pixels, [[205, 254, 254], [254, 0, 205]])
    probability = load_nav2_map(tmp_path / "map.yaml").probability
    np.testing.assert_array_equal(probability, [[0, 1, np.nan], [np.nan, 0, 0]])


def test_the_same_map_gives_the_same_bytes(occupancy: OccupancyMap, tmp_path: Path) -> None:
    contents = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        save_map(tmp_path / name, occupancy)
        contents.append({file.name: file.read_bytes() for file in (tmp_path / name).iterdir()})
    assert contents[0] == contents[1]


def test_a_truth_map_survives_saving(tmp_path: Path) -> None:
    occupied = np.eye(3, 4, dtype=np.bool_)
    truth = TruthMap(GridGeometry(0.1, (0.5, -0.5), (3, 4)), occupied)
    save_truth(tmp_path / "truth.yaml", truth)
    loaded = load_truth(tmp_path / "truth.yaml")
    assert loaded.geometry == truth.geometry
    np.testing.assert_array_equal(loaded.occupied, occupied)


def test_a_summary_is_json(tmp_path: Path, occupancy: OccupancyMap) -> None:
    told = {"pings": 3, "skipped": {"samples": 1}}
    assert save_map(tmp_path, occupancy, summarize=lambda: told) == told
    assert json.loads((tmp_path / "summary.json").read_text()) == told
    # Of another map, it would be wrong.
    save_map(tmp_path, occupancy)
    assert not (tmp_path / "summary.json").exists()


class TestFolder:
    def test_it_is_made(self, tmp_path: Path) -> None:
        with map_folder(tmp_path / "deep" / "map"):
            assert list((tmp_path / "deep" / "map").iterdir()) == []

    def test_nothing_is_left_of_a_failure(self, tmp_path: Path) -> None:
        def fail() -> None:
            with map_folder(tmp_path / "map"):
                (tmp_path / "map" / "map.npz").touch()
                raise RuntimeError

        with pytest.raises(RuntimeError):
            fail()
        assert list(tmp_path.iterdir()) == []

    def test_a_folder_that_was_there_stays(self, tmp_path: Path) -> None:
        (tmp_path / "notes.txt").touch()
        with pytest.raises(RuntimeError), map_folder(tmp_path):
            raise RuntimeError
        assert [file.name for file in tmp_path.iterdir()] == ["notes.txt"]


class TestUnusable:
    @pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 no archive"])
    def test_no_archive(self, tmp_path: Path, content: bytes) -> None:
        (tmp_path / "map.npz").write_bytes(content)
        with pytest.raises(MapFileError, match=r"is not a readable map.npz: it is damaged$"):
            load_map(tmp_path)

    def test_a_cut_archive(self, occupancy: OccupancyMap, tmp_path: Path) -> None:
        save_map(tmp_path, occupancy)
        content = (tmp_path / "map.npz").read_bytes()
        for size in range(0, len(content), 97):
            (tmp_path / "map.npz").write_bytes(content[:size])
            with pytest.raises(MapFileError):
                load_map(tmp_path)

    def test_a_lacking_array(self, tmp_path: Path) -> None:
        np.savez(tmp_path / "map.npz", log_odds=np.zeros((2, 2)))
        with pytest.raises(MapFileError, match=r"lacks the array 'observed'$"):
            load_map(tmp_path)

    @pytest.mark.parametrize(
        ("changes", "cause"),
        [
            ({"observed": np.ones((3, 3), bool)}, r"log_odds is \(2, 2\) and observed \(3, 3\)"),
            ({"log_odds": np.full((2, 2), np.nan)}, "log_odds is not finite everywhere"),
            ({"resolution": 0.0}, "resolution is 0 and origin 0, 0"),
        ],
    )
    def test_arrays_that_do_not_fit(
        self, tmp_path: Path, changes: dict[str, np.ndarray], cause: str
    ) -> None:
        arrays = {
            "log_odds": np.zeros((2, 2)), "observed": np.ones((2, 2), bool),
            "resolution": 0.05, "origin": np.zeros(2), "frame_id": "map",
        }  # fmt: skip
        np.savez(tmp_path / "map.npz", **{**arrays, **changes})
        with pytest.raises(MapFileError, match=rf"holds arrays that make no map: {cause}$"):
            load_map(tmp_path)

    def test_a_map_by_another_program(self, tmp_path: Path) -> None:
        np.savez(
            tmp_path / "map.npz", log_odds=np.zeros((2, 2)), observed=np.ones((2, 2), bool),
            resolution=0.05, origin=np.zeros(2), frame_id="map",
        )  # fmt: skip
        occupancy, paths = load_map(tmp_path / "map.npz")
        assert occupancy.stamp_ns == 0
        assert paths.positions_m == {}
