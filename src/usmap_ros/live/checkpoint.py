"""The map on disk, so that a fusion that dies loses one interval at most."""

from __future__ import annotations

from pathlib import Path

from usmap_ros.errors import MapFileError
from usmap_ros.io.map_files import GRID_FILE, load_map, map_folder, save_map
from usmap_ros.live.live_fusion import LiveFusion


class Checkpoint:
    """Keeps a map in a folder, each file of it replaced in one step.

    Parameters
    ----------
    path : str
        The folder; empty: the map is not kept.

    Raises
    ------
    MapFileError
        If the folder cannot be made or written to.
    """

    def __init__(self, path: str) -> None:
        self._path = Path(path).expanduser() if path else None
        self._kept_version = 0
        if self._path is not None:
            with map_folder(self._path):
                pass

    def restore(self, fusion: LiveFusion) -> bool:
        """Let `fusion` start from the map that was kept; whether there was one.

        Raises
        ------
        MapFileError
            If it cannot be read, or does not fit the parameters of `fusion`.
        """
        if self._path is None or not (self._path / GRID_FILE).exists():
            return False
        occupancy, _ = load_map(self._path)
        try:
            fusion.resume(occupancy)
        except ValueError as error:
            raise MapFileError(self._path, f"cannot be resumed: {error}") from error
        self._kept_version = fusion.version
        return True

    def keep(self, fusion: LiveFusion) -> None:
        """Write the map, if it has changed since the last time.

        Raises
        ------
        MapFileError
            If it cannot be written.
        """
        version = fusion.version
        if self._path is not None and version != self._kept_version:
            save_map(self._path, fusion.occupancy_map())
            self._kept_version = version
