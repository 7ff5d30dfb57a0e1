"""The services of map_fusion."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from usmap_ros.errors import MalformedMessageError, MapFileError
from usmap_ros.io.map_files import map_folder, save_map
from usmap_ros.live.interfaces import GET_MAP, PAUSE, RESET, SAVE_MAP
from usmap_ros.nodes.plumbing.endpoints import serve

if TYPE_CHECKING:
    from usmap_ros.nodes.map_fusion import MapFusion


class MapServices:
    """Hands out, saves and resets the map, and pauses its fusion.

    Parameters
    ----------
    node : MapFusion
        Whose services they are; they are there whatever its state.

    Attributes
    ----------
    is_paused : bool
        Whether cones are to be ignored.
    """

    def __init__(self, node: MapFusion) -> None:
        self._node = node
        self.is_paused = False
        serve(node, GET_MAP, self._get_map)
        serve(node, SAVE_MAP, self._save_map)
        serve(node, RESET, self._reset)
        serve(node, PAUSE, self._pause)

    def _get_map(self, request: Any, response: Any) -> Any:
        """Fill in the map; without one, the response stays empty."""
        fusion = self._node.fusion
        if fusion is not None and fusion.frame_id:
            try:
                response.map = self._node.publisher.message(fusion.occupancy_map())
            except MalformedMessageError as error:
                self._node.health.problem("unpublished", f"map: {error}", is_error=True)
        return response

    def _save_map(self, request: Any, response: Any) -> Any:
        if self._node.fusion is None:
            response.message = "the node is not configured"
            return response
        path = Path(self._node.parameters.value.save_path).expanduser()
        try:
            with map_folder(path):
                save_map(path, self._node.fusion.occupancy_map())
        except MapFileError as error:
            response.message = str(error)
        else:
            response.success, response.message = True, str((path / "map.yaml").absolute())
        return response

    def _reset(self, request: Any, response: Any) -> Any:
        if self._node.fusion is not None:
            self._node.fusion.reset()
            self._node.publisher.forget_extent()
        return response

    def _pause(self, request: Any, response: Any) -> Any:
        self.is_paused = bool(request.data)
        response.success = True
        response.message = "paused: cones are not fused" if self.is_paused else "fusing"
        return response
