"""What every way of fusing cones into a map has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from usmap_ros.errors import MalformedMessageError, UsmapError
from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.export import EXPOSURE, LOG_ODDS, as_map, fill_grid
from usmap_ros.mapping.grid import TiledGrid
from usmap_ros.numerics.arrays import RealArray
from usmap_ros.numerics.special import logit
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone


class Fusion(ABC):
    """A map that takes up one cone after the other.

    Parameters
    ----------
    parameters : MappingParameters
        Cell size, prior, clamps and sensor model.
    layers : mapping of str to float, optional
        Further layers of the grid, with their values where nothing is known.
    values_per_cell : mapping of str to int, optional
        Of the layers that have more than one.

    Attributes
    ----------
    frame_id : str
        The map's frame; empty until the first cone, unless it is set before.
    stamp_ns : int
        Stamp of the newest cone in the map.
    """

    #: Layers that last from ping to ping, and from which all others are worked out.
    LASTING_LAYERS: tuple[str, ...] = (LOG_ODDS, EXPOSURE)

    def __init__(
        self,
        parameters: MappingParameters,
        layers: dict[str, float] | None = None,
        values_per_cell: dict[str, int] | None = None,
    ) -> None:
        self.parameters = parameters
        prior = logit(parameters.prior)
        self._grid = TiledGrid(
            parameters.resolution_m,
            {LOG_ODDS: prior, EXPOSURE: 0.0, **(layers or {})},
            values_per_cell,
        )
        self.frame_id = ""
        self.stamp_ns = 0

    def fuse(self, cone: EchoCone, source: str = "") -> None:
        """Take up the evidence of one ping.

        Parameters
        ----------
        cone : EchoCone
            What was heard.
        source : str
            Who heard it, for `leave_out`.

        Raises
        ------
        MalformedMessageError
            If the cone's frame is not the map's.
        """
        if self.frame_id and cone.frame_id != self.frame_id:
            raise MalformedMessageError(
                "header.frame_id", f"is '{cone.frame_id}', the map's is '{self.frame_id}'"
            )
        self.frame_id = cone.frame_id
        self.stamp_ns = max(self.stamp_ns, cone.stamp_ns)
        self._take_up(cone, source)

    @property
    def doubted(self) -> dict[str, float]:
        """What is believed of each source by the newest map, where that is less than all of it."""
        return {}

    @property
    def memory_bytes(self) -> int:
        """Memory that the map's cells take."""
        return self._grid.memory_bytes

    @abstractmethod
    def _take_up(self, cone: EchoCone, source: str) -> None:
        """Change the grid by what a cone says."""

    def leave_out(self, is_left_out: Callable[[str], bool]) -> int:
        """Take back what some sources have said, as far as it can still be told from others'.

        Parameters
        ----------
        is_left_out : callable
            Whether a source is to be left out.

        Returns
        -------
        pings : int
            How many were taken back.
        """
        return 0

    def trust(self, shares: Mapping[str, float]) -> bool:
        """Let some sources' pings count for less; all others count wholly from now on.

        Parameters
        ----------
        shares : mapping of str to float
            How much of what each source says counts, 0 to 1.

        Returns
        -------
        has_changed : bool
            Whether that is otherwise than before; never where a way of fusing keeps no pings.
        """
        return False

    def mend(self, cone: EchoCone | None = None) -> int:
        """Make cells unknown again of which the grid holds numbers that are not finite.

        Parameters
        ----------
        cone : EchoCone, optional
            The newest one: only where it reaches, and only what lasts is looked at, and nothing
            else is kept of it if there is anything.

        Returns
        -------
        cells : int
            How many there were.
        """
        if cone is None:
            return self._grid.mend()
        x_m, y_m = map(float, cone.pose.position_m[:2])
        tiles = self._grid.tiles_around(x_m, y_m, cone.transducer.max_range_m)
        if self._grid.is_finite(self.LASTING_LAYERS, tiles):
            return 0
        self._forget_newest()
        return self._grid.mend()

    def _forget_newest(self) -> None:  # noqa: B027 - most keep nothing of a cone but cells
        """Keep nothing of the newest cone but what is in the grid."""

    def snapshot(self) -> Callable[[], OccupancyMap]:
        """What makes the map as it is now, in its own time and in any thread.

        Taking it is quick, so that the map need not stand still while it is made into a rectangle.
        """
        grid = self._grid.copied({LOG_ODDS: LOG_ODDS, EXPOSURE: EXPOSURE})
        return partial(as_map, grid, self.parameters, self.frame_id, self.stamp_ns)

    def live_snapshot(self) -> Callable[[], OccupancyMap]:
        """The same while pings come: it may tell less than `snapshot`, and takes less."""
        return self.snapshot()

    @property
    def is_whole(self) -> bool:
        """Whether a map was made of all pings so far that tells no less than another would."""
        return True

    def occupancy_map(self) -> OccupancyMap:
        """Return the map so far; nothing changes by asking for it.

        A cell counts as observed if an object in it would probably have been heard, or if it
        is not believed to be free.  A cell that echoes could neither fill nor free is not.
        """
        return self.snapshot()()

    def refine(self, passes: int) -> None:
        """Look at the recent cones again.

        Parameters
        ----------
        passes : int
            Passes through the window of recent cones.

        Raises
        ------
        UsmapError
            If this way of fusing takes each cone up once and for all.
        """
        if passes:
            raise UsmapError(f"mapping.method: {self.parameters.method} has no use for more passes")

    def resume(self, occupancy: OccupancyMap) -> None:
        """Start from a map that was exported before.

        Raises
        ------
        ValueError
            If its resolution or origin does not fit this grid.
        """
        fill_grid(self._grid, occupancy, self.parameters)
        self.frame_id = occupancy.frame_id or self.frame_id
        self.stamp_ns = occupancy.stamp_ns

    def _clamped(self, log_odds: RealArray | NDArray[np.float32]) -> RealArray:
        clamped: RealArray = np.clip(
            log_odds.astype(np.float64),
            self.parameters.least_log_odds,
            self.parameters.greatest_log_odds,
        )
        return clamped
