"""The map of all kept pings, worked out once, in any thread."""

import threading
from collections.abc import Callable

from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.joint.drawing import copied, drawn_map
from usmap_ros.mapping.joint.explanation import Explanation, explained
from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.parameters import MappingParameters
from usmap_ros.processes.memory import give_back_memory
from usmap_ros.processes.workers import Beside

Tell = Callable[[Explanation, OccupancyMap | None], None]


class Survey:
    """The map of some pings; to make it takes little, to ask it for anything seconds.

    Parameters
    ----------
    kept : KeptPings
        The pings, which nobody else changes.
    parameters : MappingParameters
        Of the map.
    earlier : callable, optional
        Returns what was known before, which holds where the pings say nothing; told `is_beside`, as
        `occupancy_map` is.
    more_rounds : int
        Rounds of shadows and sweeps beyond the usual ones.
    frame_id, stamp_ns
        Of the map.
    tell : callable
        Told what is known of the areas, and was before, when that is worked out.
    """

    def __init__(
        self,
        kept: KeptPings,
        parameters: MappingParameters,
        earlier: Callable[[bool], OccupancyMap] | None,
        more_rounds: int,
        frame_id: str,
        stamp_ns: int,
        tell: Tell = lambda known, earlier: None,
    ) -> None:
        self._kept, self._parameters, self._before = kept, parameters, earlier
        self._more_rounds, self.frame_id, self.stamp_ns = more_rounds, frame_id, stamp_ns
        self._tell, self._lock = tell, threading.Lock()
        self._map: OccupancyMap | None = None

    def occupancy_map(self, is_beside: bool = False) -> OccupancyMap:
        """The map; whoever asked may change it.

        Parameters
        ----------
        is_beside : bool
            Whether it is worked out in another process, if there is one, for it takes long.
        """
        with self._lock:
            if self._map is None:
                earlier = self._before and self._before(is_beside)
                given = self._kept, self._parameters, earlier, self._more_rounds
                known = Beside(explained, *given).result() if is_beside else explained(*given)
                self._map = drawn_map(
                    known.areas, self._parameters, earlier, self.frame_id, self.stamp_ns
                )
                self._tell(known, earlier)
                # Nothing stays but the map: what it was made from is many times as large, and
                # earlier surveys hold those that were before them.
                self._kept, self._before = KeptPings(self._parameters), None
                self._tell = lambda known, earlier: None
                del known, given, earlier
                give_back_memory()
            return copied(self._map)

    @property
    def is_made(self) -> bool:
        """Whether the map is there."""
        return self._map is not None
