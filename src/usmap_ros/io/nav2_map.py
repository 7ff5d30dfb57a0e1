"""Maps in nav2's own format: an image, and a YAML file that says how to read it."""

from __future__ import annotations

import math
import struct
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import yaml
from numpy.typing import NDArray

from usmap_ros.bounds import MAX_PIXELS
from usmap_ros.errors import MapFileError, file_errors, shortened
from usmap_ros.grids import FREE_VALUE, OCCUPIED_PROBABILITY, OCCUPIED_VALUE, GridGeometry
from usmap_ros.io.file_set import replace_files
from usmap_ros.io.yaml_text import read_yaml
from usmap_ros.numerics.arrays import FloatArray

if TYPE_CHECKING:
    from PIL import Image

#: Shades of gray that nav2 and the map server of ROS 1 use.
_OCCUPIED_SHADE, _FREE_SHADE, _UNKNOWN_SHADE = 0, 254, 205
#: Just below the 0.19608 that the shade of an unknown cell stands for; nav2's default frees it.
_FREE_THRESHOLD = 0.196
#: Most characters of a wrong value that are quoted.
_QUOTED = 60
_MODES = ("trinary", "scale", "raw")


@dataclass(frozen=True)
class Nav2Map:
    """A map as nav2 understands it."""

    geometry: GridGeometry
    #: (rows, columns) array: of being occupied; NaN where unknown.
    probability: FloatArray


def save_nav2_map(path: Path, geometry: GridGeometry, values: NDArray[np.int8]) -> None:
    """Write a trinary map: a YAML file at `path`, and an image of the same name beside it.

    Parameters are those of `nav2_files`.

    Raises
    ------
    MapFileError
        If a file cannot be written: then both are as they were.
    """
    with file_errors(MapFileError, path):
        replace_files(path.parent, nav2_files(path, geometry, values))


def nav2_files(path: Path, geometry: GridGeometry, values: NDArray[np.int8]) -> dict[str, bytes]:
    """Contents, by name, of the two files of a trinary map: an image and a YAML file.

    Parameters
    ----------
    path : path
        Of the YAML file, ending in ``.yaml``; the image has the same name but for that.
    geometry : GridGeometry
        Where the cells lie.
    values : (rows, columns) int8 array
        As `OccupancyMap.trinary` gives them.
    """
    shades = np.full(values.shape, _UNKNOWN_SHADE, dtype=np.uint8)
    shades[values == FREE_VALUE] = _FREE_SHADE
    shades[values == OCCUPIED_VALUE] = _OCCUPIED_SHADE
    rows, columns = geometry.shape
    # The first row of an image is the top one.
    image = b"P5\n%d %d\n255\n" % (columns, rows) + shades[::-1].tobytes()
    image_path = path.with_suffix(".pgm")
    description = {
        "image": image_path.name,
        "mode": "trinary",
        "resolution": float(geometry.resolution_m),
        "origin": [*map(float, geometry.origin_m), 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_PROBABILITY,
        "free_thresh": _FREE_THRESHOLD,
    }
    text = yaml.safe_dump(description, sort_keys=False, default_flow_style=None)
    # Last, so that it never names an image that is not there.
    return {image_path.name: image, path.name: text.encode()}


def load_nav2_map(path: Path) -> Nav2Map:
    """Load any map that nav2's map server loads: modes trinary, scale and raw.

    Parameters
    ----------
    path : path
        The YAML file; the image's path in it is relative to it.

    Raises
    ------
    MapFileError
        If a file is missing, or says what cannot be.
    """
    description = _Description(path)
    resolution = description.number("resolution")
    if not resolution > 0.0:
        raise MapFileError(path, f"resolution is {resolution:g}, must be above 0")
    origin = description.origin()
    mode = description.content.get("mode", "trinary")
    if mode not in _MODES:
        raise MapFileError(path, f"mode is {mode!r}, must be one of {', '.join(_MODES)}")
    image = _load_image(path.parent / description.text("image"))
    probability = _probability(image, mode, description)
    geometry = GridGeometry(resolution, origin, (image.height, image.width))
    return Nav2Map(geometry, probability[::-1])


def _probability(image: Image.Image, mode: str, description: _Description) -> FloatArray:
    """Probability of every pixel in one of nav2's modes; NaN where unknown."""
    sums, shade = _shades(image, mode)
    # Worked out for each shade, not for each pixel: of those there may be millions.
    probability: FloatArray = _probability_of(shade, mode, description)[sums]
    if mode == "scale" and image.mode.endswith("A"):
        probability[np.asarray(image)[..., -1] < 255] = np.nan
    return probability


def _probability_of(shade: FloatArray, mode: str, description: _Description) -> FloatArray:
    """Probability of each of some shades, from 0 to 1; NaN where unknown."""
    occupied_share = shade if description.number("negate", 0) else 1.0 - shade
    if mode == "raw":
        value = np.rint(shade * 255.0)
        return np.where(value <= 100.0, value / 100.0, np.nan)
    occupied = description.number("occupied_thresh", 0.65)
    free = description.number("free_thresh", 0.25)
    if not 0.0 <= free < occupied <= 1.0:
        raise MapFileError(
            description.path, f"free_thresh ({free:g}) must be below occupied_thresh ({occupied:g})"
        )
    between = (occupied_share - free) / (occupied - free) if mode == "scale" else np.nan
    probability = np.where(occupied_share < free, 0.0, between)
    return np.where(occupied_share > occupied, 1.0, probability)


def _load_image(path: Path) -> Image.Image:
    """Load an image as gray or color, with or without transparency."""
    # Here, because maps are written without it.
    from PIL import Image

    try:
        # What a reader of images has to say of one that it reads all the same is of no use here.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path) as image:
                _check_size(path, image)
                has_alpha = "A" in image.getbands() or "transparency" in image.info
                color = "RGB" if image.mode in ("RGB", "RGBA", "P", "CMYK", "YCbCr") else "L"
                target = {"RGB": "RGBA", "L": "LA"}[color] if has_alpha else color
                return image.convert(target)
    except FileNotFoundError as error:
        raise MapFileError(path, "does not exist") from error
    except Image.DecompressionBombError as error:
        raise MapFileError(path, f"has more than {MAX_PIXELS} pixels") from error
    # A damaged image fails in as many ways as there are formats.
    except (
        ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, SyntaxError, TypeError,
        ValueError, struct.error,
    ) as error:  # fmt: skip
        raise MapFileError(path, "is not a readable image") from error


def _check_size(path: Path, image: Image.Image) -> None:
    """Refuse an image before its pixels are unpacked: few bytes can stand for very many."""
    width, height = image.size
    if width * height > MAX_PIXELS:
        raise MapFileError(
            path, f"has {width} x {height} pixels, more than {MAX_PIXELS} are not taken"
        )


def _shades(image: Image.Image, mode: str) -> tuple[NDArray[np.integer], FloatArray]:
    """Sum of each pixel's channels, and the shade, from 0 to 1, that each sum stands for.

    nav2 counts opacity in where it is trinary.
    """
    values = np.asarray(image)
    if values.ndim == 2:
        return values, np.arange(256) / 255.0
    channels = values if mode == "trinary" or not image.mode.endswith("A") else values[..., :-1]
    sums = channels[..., 0].astype(np.uint16)
    for number in range(1, channels.shape[-1]):
        sums += channels[..., number]
    greatest = 255 * channels.shape[-1]
    return sums, np.arange(greatest + 1) / greatest


class _Description:
    """The YAML file of a map."""

    def __init__(self, path: Path) -> None:
        self.path = path
        content = read_yaml(path, MapFileError)
        if not isinstance(content, dict):
            raise MapFileError(path, "is not a map description: it has no keys")
        self.content = content

    def text(self, key: str) -> str:
        """Value of a key that must be there."""
        if key not in self.content:
            raise MapFileError(self.path, f"has no {key!r}")
        return str(self.content[key])

    def number(self, key: str, default: float | None = None) -> float:
        """Value of a key as a finite number."""
        text = self.text(key) if default is None else self.content.get(key, default)
        try:
            number = float(text)
        except (TypeError, ValueError, OverflowError) as error:
            value = shortened(repr(text), _QUOTED)
            raise MapFileError(self.path, f"{key} is {value}, must be a number") from error
        if not math.isfinite(number):
            raise MapFileError(self.path, f"{key} is {number}, must be finite")
        return number

    def origin(self) -> tuple[float, float]:
        """Lower-left corner; a rotated map is refused, because nav2 ignores the rotation."""
        origin = self.content.get("origin")
        try:
            x, y, yaw = (float(value) for value in origin or ())
        except (TypeError, ValueError, OverflowError) as error:
            value = shortened(repr(origin), _QUOTED)
            raise MapFileError(
                self.path, f"origin is {value}, must be a list of x, y and yaw"
            ) from error
        if not (math.isfinite(x) and math.isfinite(y)):
            raise MapFileError(self.path, f"origin is {x}, {y}, must be finite")
        if yaw != 0.0:
            raise MapFileError(self.path, f"origin is turned by {yaw:g} rad, must be 0")
        return x, y
