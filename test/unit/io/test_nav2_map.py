from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from PIL import Image

from usmap_ros.errors import MapFileError
from usmap_ros.io.nav2_map import load_nav2_map

WriteMap = Callable[..., Path]

UNKNOWN = np.nan


@pytest.fixture
def write_map(tmp_path: Path) -> WriteMap:
    """Give a function that writes pixels and the description of a map."""

    def write(pixels: Any, *, suffix: str = "png", **description: Any) -> Path:
        image = Image.fromarray(np.asarray(pixels, dtype=np.uint8))
        image.save(tmp_path / f"map.{suffix}")
        content = {
            "image": f"map.{suffix}", "resolution": 0.1, "origin": [1.0, 2.0, 0.0], "negate": 0,
            "occupied_thresh": 0.65, "free_thresh": 0.196, **description,
        }  # fmt: skip
        kept = {key: value for key, value in content.items() if value is not None}
        (tmp_path / "map.yaml").write_text(yaml.safe_dump(kept))
        return tmp_path / "map.yaml"

    return write


@pytest.mark.parametrize(
    ("pixels", "description", "expected"),
    [
        ([[0, 254, 205]], {}, [[1, 0, UNKNOWN]]),
        ([[255, 1, 50]], {"negate": 1}, [[1, 0, UNKNOWN]]),
        ([[0], [254]], {}, [[0], [1]]),
        ([[0, 51, 100, 101, 255]], {"mode": "raw"}, [[0, 0.51, 1, UNKNOWN, UNKNOWN]]),
        ([[0, 255]], {"mode": "scale"}, [[1, 0]]),
        ([[102]], {"mode": "scale", "occupied_thresh": 0.8, "free_thresh": 0.2}, [[2 / 3]]),
        # Transparent is unknown in mode scale.
        ([[[0, 255], [0, 0]]], {"mode": "scale"}, [[1, UNKNOWN]]),
        # Of colours, the mean counts.
        ([[[0, 0, 0], [254, 254, 254]]], {}, [[1, 0]]),
    ],
)
def test_modes(
    write_map: WriteMap, pixels: Any, description: dict[str, Any], expected: Any
) -> None:
    probability = load_nav2_map(write_map(pixels, **description)).probability
    np.testing.assert_allclose(probability, expected, atol=1e-12)


@pytest.mark.parametrize("suffix", ["png", "pgm", "bmp"])
def test_kinds_of_images(write_map: WriteMap, suffix: str) -> None:
    nav2_map = load_nav2_map(write_map([[0, 254], [205, 0]], suffix=suffix))
    np.testing.assert_array_equal(nav2_map.probability, [[UNKNOWN, 1], [1, 0]])
    assert nav2_map.geometry.resolution_m == 0.1
    assert nav2_map.geometry.origin_m == (1.0, 2.0)
    assert nav2_map.geometry.shape == (2, 2)


@pytest.mark.parametrize(
    ("description", "cause"),
    [
        ({"resolution": None}, "has no 'resolution'"),
        ({"resolution": 0}, "resolution is 0, must be above 0"),
        ({"resolution": "fine"}, "resolution is 'fine', must be a number"),
        ({"resolution": float("nan")}, "resolution is nan, must be finite"),
        ({"image": None}, "has no 'image'"),
        ({"origin": [1.0, 2.0]}, "origin is [1.0, 2.0], must be a list of x, y and yaw"),
        ({"origin": [1.0, 2.0, 0.5]}, "origin is turned by 0.5 rad, must be 0"),
        ({"origin": None}, "origin is None, must be a list of x, y and yaw"),
        ({"mode": "fancy"}, "mode is 'fancy', must be one of trinary, scale, raw"),
        ({"free_thresh": 0.9}, "free_thresh (0.9) must be below occupied_thresh (0.65)"),
    ],
)
def test_what_cannot_be_is_named(
    write_map: WriteMap, description: dict[str, Any], cause: str
) -> None:
    path = write_map([[0]], **description)
    with pytest.raises(MapFileError) as raised:
        load_nav2_map(path)
    assert str(raised.value) == f"{path}: {cause}"


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(MapFileError, match=r"none.yaml: does not exist$"):
        load_nav2_map(tmp_path / "none.yaml")


def test_a_missing_image_is_named(write_map: WriteMap) -> None:
    path = write_map([[0]], image="other.png")
    with pytest.raises(MapFileError, match=r"other.png: does not exist$"):
        load_nav2_map(path)


def test_a_broken_image_is_named(write_map: WriteMap, tmp_path: Path) -> None:
    path = write_map([[0]])
    (tmp_path / "map.png").write_bytes(b"\x89PNG but not for long")
    with pytest.raises(MapFileError, match=r"map.png: is not a readable image$"):
        load_nav2_map(path)


@pytest.mark.parametrize(
    ("text", "cause"), [("[", "line 1: expected the node"), ("", "is not a map description")]
)
def test_a_broken_description_is_named(tmp_path: Path, text: str, cause: str) -> None:
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(MapFileError, match=cause):
        load_nav2_map(tmp_path / "map.yaml")
