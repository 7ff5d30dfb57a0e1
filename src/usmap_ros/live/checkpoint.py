"""The map on disk, so that a fusion that dies loses one interval at most."""

from pathlib import Path

from usmap_ros.errors import MapFileError, MapSizeError, file_errors
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
        #: Why a map that was kept could not be used; empty if all is well.
        self.trouble = ""
        if self._path is not None:
            with map_folder(self._path):
                pass

    def restore(self, fusion: LiveFusion) -> bool:
        """Let `fusion` start from the map that was kept; whether there was one.

        One that is damaged is renamed, and the reason is in `trouble`: a robot must not stand
        still because a disk was full, and whoever looks after it may still want the file.

        Raises
        ------
        MapFileError
            If it does not fit the parameters of `fusion`, or cannot be renamed.
        """
        if self._path is None or not (self._path / GRID_FILE).exists():
            return False
        try:
            occupancy, _ = load_map(self._path)
        except MapFileError as error:
            self.trouble = f"{error}; set aside as {self._set_aside(self._path).name}"
            return False
        try:
            fusion.resume(occupancy)
        except (ValueError, MapSizeError) as error:
            raise MapFileError(self._path, f"cannot be resumed: {error}") from error
        self._kept_version = fusion.version
        return True

    def _set_aside(self, folder: Path) -> Path:
        """Rename the damaged file; its new name."""
        number = 1
        while (target := folder / f"{GRID_FILE}.damaged-{number}").exists():
            number += 1
        with file_errors(MapFileError, folder):
            (folder / GRID_FILE).rename(target)
        return target

    def keep(self, fusion: LiveFusion, *, in_time: bool = False) -> None:
        """Write the map, if it has changed since the last time.

        Parameters
        ----------
        fusion : LiveFusion
            Whose map.
        in_time : bool
            Whether that of late will do, where to explain all pings together would take long.

        Raises
        ------
        MapFileError
            If it cannot be written.
        """
        version = fusion.version
        if self._path is not None and version != self._kept_version:
            try:
                occupancy = fusion.live_map() if in_time else fusion.occupancy_map()
            except MapSizeError as error:
                raise MapFileError(self._path, str(error)) from error
            save_map(self._path, occupancy)
            # One that is better is kept when it is there.
            self._kept_version = -1 if in_time and not fusion.is_whole else version
