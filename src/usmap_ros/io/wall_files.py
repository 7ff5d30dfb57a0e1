"""Known walls in a file: segments that reflect, stated or found in a map."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
from pydantic import model_validator

from usmap_ros.acoustics.images import Mirrors
from usmap_ros.io.atomic import write_atomically
from usmap_ros.io.yaml_files import dump_yaml, load_yaml
from usmap_ros.parameters import ParameterGroup, quantity


class WallSegment(ParameterGroup):
    """A straight upright wall that reflects on either side."""

    start_m: tuple[float, float] = quantity(..., "x, y of one end, in the world frame.", "m")
    end_m: tuple[float, float] = quantity(..., "x, y of the other end.", "m")
    reflectivity: float = quantity(0.3, "Amplitude reflectivity as a mirror.", gt=0.0, le=1.0)

    @model_validator(mode="after")
    def _has_length(self) -> WallSegment:
        if self.start_m == self.end_m:
            raise ValueError(f"end_m: the wall at {self.start_m} has no length")
        return self


class KnownWalls(ParameterGroup):
    """All walls that are known."""

    walls: list[WallSegment] = quantity([], "The walls.")

    def mirrors(self) -> Mirrors:
        """The walls as mirrors."""
        return Mirrors(
            np.array([wall.start_m for wall in self.walls]).reshape(-1, 2),
            np.array([wall.end_m for wall in self.walls]).reshape(-1, 2),
            np.array([wall.reflectivity for wall in self.walls]),
        )


def load_walls(path: str) -> Mirrors:
    """Walls of a file; none without one.  It is read again only when it has changed.

    Raises
    ------
    ConfigurationError
        If there is no such file, or no walls in it.
    """
    if not path:
        return Mirrors.none()
    file = Path(path).expanduser()
    try:
        changed_ns = file.stat().st_mtime_ns
    except (OSError, ValueError):
        # What is wrong with it, its reader says.
        changed_ns = -1
    return _read(file, changed_ns)


@lru_cache(maxsize=8)
def _read(file: Path, changed_ns: int) -> Mirrors:
    return load_yaml(file, KnownWalls).mirrors()


def save_walls(path: Path, walls: KnownWalls) -> None:
    """Write walls to a file, in a moment or not at all."""
    write_atomically(path, dump_yaml(walls).encode())
