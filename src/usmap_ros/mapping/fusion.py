"""What every way of fusing cones into a map has in common."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping

import numpy as np

from usmap_ros.errors import MalformedMessageError, UsmapError
from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.common_error import NO_ERROR, CommonError
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Evidence that shifts log-odds by less than this, as at the rim of a beam, says nothing.
LEAST_NEWS = 0.05


class Fusion(ABC):
    """A map that takes up one cone after the other.

    Parameters
    ----------
    parameters : MappingParameters
        Cell size, prior, clamps and sensor model.

    Attributes
    ----------
    frame_id : str
        The map's frame; empty until the first cone, unless it is set before.
    stamp_ns : int
        Stamp of the newest cone in the map.
    """

    def __init__(self, parameters: MappingParameters) -> None:
        self.parameters = parameters
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
    def common_error(self) -> CommonError:
        """What is wrong with all pings, and is not in the newest map any more."""
        return NO_ERROR

    @property
    def is_behind(self) -> bool:
        """Whether pings that had come are not in the newest live map that was made in time."""
        return False

    @property
    def thinned(self) -> int:
        """Pings that went before what they said was worked out, since more came than could be."""
        return 0

    @property
    @abstractmethod
    def memory_bytes(self) -> int:
        """Memory that what is known takes."""

    @abstractmethod
    def _take_up(self, cone: EchoCone, source: str) -> None:
        """Take up what a cone says."""

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

    @abstractmethod
    def mend(self, cone: EchoCone | None = None) -> int:
        """Let go of numbers that are not finite, and make their cells unknown again.

        Parameters
        ----------
        cone : EchoCone, optional
            The newest one: only what it may have changed is looked at.

        Returns
        -------
        cells : int
            How many there were.
        """

    @abstractmethod
    def snapshot(self) -> Callable[[], OccupancyMap]:
        """What makes the map as it is now, in its own time and in any thread.

        Taking it is quick, so that the map need not stand still while it is made into a rectangle.
        """

    def live_snapshot(
        self, in_time: bool = False, is_last: bool = False
    ) -> Callable[[], OccupancyMap]:
        """The same while pings come: it may tell less than `snapshot`, and takes less.

        Parameters
        ----------
        in_time : bool
            Whether what takes long goes on beside, in a thread of its own, and is in a later map.
        is_last : bool
            Whether no more pings seem to come, so that a later map is to tell all that there is.
        """
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
            If its cells are of another size, or its origin is not where cells begin.
        """
        geometry, side_m = occupancy.geometry, self.parameters.resolution_m
        if not np.isclose(geometry.resolution_m, side_m, rtol=1e-6):
            raise ValueError(f"its cells are {geometry.resolution_m:g} m and not {side_m:g} m")
        first = np.array(geometry.origin_m) / side_m
        if np.any(np.abs(first - np.rint(first)) > 1e-3):
            raise ValueError(f"its origin {geometry.origin_m} is not a multiple of the resolution")
        self.frame_id = occupancy.frame_id or self.frame_id
        self.stamp_ns = occupancy.stamp_ns
