"""Joint fusion: the map is what explains all pings together, whatever order they came in."""

import weakref
from collections.abc import Callable, Mapping

import numpy as np

from usmap_ros.errors import UsmapError
from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.common_error import NO_ERROR, CommonError
from usmap_ros.mapping.fusion import Fusion
from usmap_ros.mapping.joint.area_state import least_credit
from usmap_ros.mapping.joint.drawing import copied
from usmap_ros.mapping.joint.explanation import Explanation
from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.joint.live_map import LiveMap
from usmap_ros.mapping.joint.local_origin import LocalOrigin
from usmap_ros.mapping.joint.survey import Survey
from usmap_ros.numerics.special import logit
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Variance of a bearing, rad², below which its weight may be beyond all numbers.
LEAST_VARIANCE = 1e-30
#: Share of the window that goes at once when it is full; what it said stays in the map.
RETIRED_SHARE = 2
#: So many times that may be kept until what it said has been worked out: as much as two windows.
MOST_WAITING = 4
#: A live map begins with so many pings at the most: those beyond wait for less beside them.
FIRST_PINGS = 64


class JointFusion(Fusion):
    """A map that explains all pings of its window together.

    A ping is only kept when it comes; the map is worked out when somebody asks for it, from all
    pings at once and from the start.  So it depends on the pings alone: not on how often it was
    looked at, and but for the order of sums not on the order of robots.

    Parameters
    ----------
    parameters : MappingParameters
        Of the model.
    """

    def __init__(self, parameters: MappingParameters) -> None:
        super().__init__(parameters)
        self._kept = KeptPings(parameters)
        # From which all is counted that is kept, by the first ping or an earlier map.
        self._origin: LocalOrigin | None = None
        # What those before the window have said.
        self._earlier: Callable[[bool], OccupancyMap] | None = None
        self._retired: Survey | None = None
        # The same of all whose map may not be made yet; only who needs them keeps them.
        self._waiting: list[weakref.ref[Survey]] = []
        self._more_rounds = 0
        self._survey: Survey | None = None
        self._doubted: dict[str, float] = {}
        self._common_error = NO_ERROR
        self._count = self._thinned = 0
        # None as long as nobody asks for the map while pings come.
        self._live: LiveMap | None = None
        # The survey that it begins with, as long as it has not.
        self._first: Survey | None = None
        # Whether the latest live map tells less than a whole one would.
        self._is_live_latest = False

    def _take_up(self, cone: EchoCone, source: str) -> None:
        if len(self._kept) >= self.parameters.window:
            self._retire()
        self._count += 1
        if self._origin is None:
            x_m, y_m, _ = cone.pose.position_m.tolist()
            self._origin = LocalOrigin.near(x_m, y_m, self.parameters.resolution_m)
        cone = self._origin.cone(cone)
        is_new = self._kept.add(cone, source)
        # All from one place count as one, whether they come before or after.
        if self._live is not None and is_new and self._kept.is_believed(source):
            self._live.add(cone, source, self._count)
        self._survey = None
        if self._live is not None and len(self._kept) == FIRST_PINGS:
            self._first = self._surveyed()

    def _retire(self) -> None:
        """Let the oldest pings go, and what they said stay.

        That is worked out when the next map is, or beside.  Where there would be more pings in
        memory than three windows hold, whoever fuses waits for it; but live, nobody may wait, and
        a share of the window goes and says no more.
        """
        living = [survey for each in self._waiting if (survey := each()) is not None]
        waiting = [survey for survey in living if not survey.is_made]
        if len(waiting) >= MOST_WAITING:
            if self._live is not None:
                self._thinned += self._kept.thin()
                return
            waiting.pop(0).occupancy_map()
        self._retired = self._surveyed()
        self._earlier = self._retired.occupancy_map
        self._waiting = [weakref.ref(survey) for survey in (*waiting, self._retired)]
        self._kept.drop_oldest(max(1, self.parameters.window // RETIRED_SHARE))

    def _forget_newest(self) -> None:
        self._kept.drop_newest()
        self._changed()

    def _changed(self) -> None:
        """Nothing that was worked out holds any more."""
        self._survey = self._first = None
        if self._live is not None:
            self._live.forget()

    def mend(self, cone: EchoCone | None = None) -> int:
        """Let the newest ping go if its numbers are not finite; or such cells of an earlier map."""
        if cone is not None:
            wrong = _not_finite(cone)
            if wrong:
                self._forget_newest()
            return wrong
        if self._earlier is None:
            return 0
        before = self._earlier(False)
        cells = ~np.isfinite(before.log_odds)
        before.log_odds[cells], before.observed[cells] = logit(self.parameters.prior), False
        self._earlier = lambda is_beside: before
        self._changed()
        return int(np.count_nonzero(cells))

    def leave_out(self, is_left_out: Callable[[str], bool]) -> int:
        """Take some sources' pings out; nothing that they said stays, if they are in the window."""
        pings = self._kept.leave_out(is_left_out)
        if pings:
            self._changed()
        return pings

    def trust(self, shares: Mapping[str, float]) -> bool:
        """Let some sources' pings count for less, of the window; see `KeptPings.believe`."""
        if not self.parameters.weigh_robots or not self._kept.believe(shares):
            return False
        self._survey = None
        if self._live is not None:
            self._live.outdate()
        return True

    def refine(self, passes: int) -> None:
        """Let every map from now on be made with more rounds of shadows and sweeps."""
        if passes < 0:
            raise UsmapError(f"passes: is {passes}, must not be negative")
        if passes:
            self._more_rounds += passes
            self._changed()

    @property
    def doubted(self) -> dict[str, float]:
        """What is believed of each source by the newest map, where that is less than all of it."""
        return self._doubted

    @property
    def common_error(self) -> CommonError:
        """What is wrong with all pings, and is not in the newest map of all pings any more."""
        return self._common_error

    @property
    def thinned(self) -> int:
        """Pings that went before what they said was worked out, since more came than could be."""
        return self._thinned

    @property
    def memory_bytes(self) -> int:
        """Memory that the kept pings take."""
        return self._kept.memory_bytes

    def snapshot(self) -> Callable[[], OccupancyMap]:
        """What makes the map as it is now, in its own time and in any thread."""
        return self._in_frame(self._surveyed().occupancy_map)

    def _in_frame(self, make: Callable[[], OccupancyMap]) -> Callable[[], OccupancyMap]:
        origin = self._origin
        return make if origin is None else lambda: origin.in_frame(make())

    def live_snapshot(
        self, in_time: bool = False, is_last: bool = False
    ) -> Callable[[], OccupancyMap]:
        """What makes the map of late: where most is known, new pings alone are visited.

        From time to time, by how many pings there are, all are explained together as in `snapshot`.
        """
        if self._live is None:
            self._live = LiveMap(self.parameters)
            self._survey = None
        live, whole, retired, newest = self._live, self._surveyed(), self._retired, self._count
        if live.is_begun:
            self._first = None
        first = self._first

        def made() -> OccupancyMap:
            if in_time and first is not None and not live.is_begun:
                first.occupancy_map()
            is_waiting = retired is not None and not retired.is_made
            if not whole.is_made and (is_last or is_waiting or live.is_due):
                due = retired if retired is not None and is_waiting else whole
                if in_time and live.is_begun:
                    live.renew(lambda: due.occupancy_map(is_beside=True))
                else:
                    due.occupancy_map()
            found = None
            if not whole.is_made:
                goes_on = in_time and live.is_begun
                found = live.occupancy_map(whole.frame_id, whole.stamp_ns, newest, goes_on)
            self._is_live_latest = found is not None
            return whole.occupancy_map() if found is None else found

        return self._in_frame(made)

    @property
    def is_whole(self) -> bool:
        """Whether all pings so far were explained together, by the latest live map as well."""
        is_made = self._survey is not None and self._survey.is_made
        return is_made and not self._is_live_latest

    @property
    def is_behind(self) -> bool:
        """Whether pings that had come are not in the newest live map that was made in time."""
        return self._live is not None and self._is_live_latest and self._live.is_behind

    def _surveyed(self) -> Survey:
        """The survey of today's pings, which is worked out when it is asked."""
        if self._survey is None:
            live, count = self._live, self._count
            epoch = 0 if live is None else live.epoch

            def tell(known: Explanation, earlier: OccupancyMap | None) -> None:
                self._doubted = least_credit(known.areas)
                self._common_error = known.sensors.common_error
                if live is not None:
                    live.begin(known, earlier, count, epoch)

            self._survey = Survey(
                self._kept.copy(), self.parameters, self._earlier, self._more_rounds, self.frame_id,
                self.stamp_ns, tell,
            )  # fmt: skip
        return self._survey

    def resume(self, occupancy: OccupancyMap) -> None:
        """Start from a map that was exported before.

        Raises
        ------
        ValueError
            If its resolution or origin does not fit this grid.
        """
        super().resume(occupancy)
        if self._origin is None:
            self._origin = LocalOrigin.near(
                *occupancy.geometry.origin_m, self.parameters.resolution_m
            )
        before = self._origin.from_here(copied(occupancy))
        self._earlier, self._retired = (lambda is_beside: before), None
        self._changed()


def _not_finite(cone: EchoCone) -> int:
    """Numbers of a cone that are not finite in the range bins that maps are made from."""
    numbers = [*cone.pose.position_m, cone.pose.yaw_rad, cone.transducer.max_range_m]
    squares = np.square(np.asarray(cone.amplitudes, np.float32))
    wrong = np.count_nonzero(~np.isfinite(numbers)) + np.count_nonzero(~np.isfinite(squares))
    if cone.bearings_rad is not None and cone.bearing_stds_rad is not None:
        # What is that certain has a weight beyond all numbers.
        stds = cone.bearing_stds_rad[~np.isnan(cone.bearings_rad)]
        wrong += np.count_nonzero(np.square(np.asarray(stds, np.float32)) < LEAST_VARIANCE)
    return int(wrong)
