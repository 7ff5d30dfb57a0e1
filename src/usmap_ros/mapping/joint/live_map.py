"""The map while pings come: what is known of all of them but the newest, and those beside it."""

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.joint.area_state import AreaState
from usmap_ros.mapping.joint.drawing import copied, drawn_map
from usmap_ros.mapping.joint.explanation import Explanation
from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.joint.more_pings import MorePings
from usmap_ros.mapping.joint.sensors import Sensors
from usmap_ros.mapping.joint.telling_pings import telling
from usmap_ros.mapping.joint.visibility.field import field_around
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.processes.threads import alone
from usmap_ros.processes.workers import Beside

#: All pings are explained together again when there are such a share more than the last time; and
#: always as long as there are so few.
MORE_SHARE, FEW_PINGS = 0.5, 30
#: Pings that are explained at once, for good, beside those before them: so many at the least, and
#: so many times as many at the most, which takes three fifths of the time for each.
BATCH, TOGETHER = 32, 4
#: Name of the thread that waits for all pings to be explained together while maps go on being made.
BESIDE = "usmap whole map"

#: A ping, who heard it, and its number.
Numbered = tuple[EchoCone, str, int]


class _Known(NamedTuple):
    """What is known of all areas, which whole batches are added to where it is."""

    #: Of each.
    areas: list[AreaState]
    #: Number of the newest ping of theirs.
    newest: int
    #: By all pings that were explained together.
    sensors: Sensors
    #: What was known before any of them.
    earlier: OccupancyMap | None


class _Drawn(NamedTuple):
    """The map of what is known, with pings up to one of some number."""

    areas: list[AreaState]
    newest: int
    occupancy: OccupancyMap


_NOTHING = _Known([], 0, Sensors(set(), {}), None)


class LiveMap:
    """What is known of the pings so far, each of which is visited once until all are again.

    Parameters
    ----------
    parameters : MappingParameters
        Of the map.

    Attributes
    ----------
    epoch : int
        Rises whenever what is known is forgotten.
    is_behind : bool
        Whether pings that had come are not in the newest map that was made in time.
    """

    def __init__(self, parameters: MappingParameters) -> None:
        # Of what others ask for at any time, and while a map is made: pings that come do not wait.
        self._parameters, self._lock, self._making = parameters, threading.Lock(), threading.Lock()
        self._known = _NOTHING
        self._drawn: _Drawn | None = None
        self.epoch, self.is_behind = 0, False
        # Number of the newest ping by which areas were known at first, and how many those were.
        self._first = self._pings = 0
        # Whether something is known that it does not tell.
        self._is_outdated = False
        # Pings after that.
        self._more: list[Numbered] = []
        self._renewal: threading.Thread | None = None
        self._failure: Exception | None = None

    def add(self, cone: EchoCone, source: str, number: int) -> None:
        """Take up a ping."""
        with self._lock:
            self._more.append((cone, source, number))

    def forget(self) -> None:
        """Begin with all pings at the next time."""
        with self._lock:
            self._known, self._pings, self._more = self._known._replace(areas=[]), 0, []
            self.epoch += 1

    def outdate(self) -> None:
        """Have all pings explained together anew, and go on with what was known until they are."""
        with self._lock:
            self._is_outdated = True
            self.epoch += 1

    def begin(
        self,
        found: Explanation,
        earlier: OccupancyMap | None,
        number: int,
        epoch: int,
    ) -> None:
        """Go on from what is known by all pings, with those that have come since.

        Where more have come than are known, or come than can be added meanwhile, all goes on from
        what was known before.

        Parameters
        ----------
        found : Explanation
            What is known.
        earlier : OccupancyMap, optional
            What was known before any of them.
        number : int
            Of the newest of them.
        epoch : int
            When they were told: nothing holds that was told before the last `forget` or `outdate`.
        """
        (areas, sensors, pings), newest, has_all = found, number, True
        most = pings
        while True:
            with self._lock:
                if number < self._first or epoch != self.epoch:
                    return
                # Maps are made meanwhile of what was known until now.
                behind = [ping for ping in self._more if newest < ping[2] <= self._known.newest]
                if not behind:
                    self._known = _Known(areas, newest, sensors, earlier)
                    self._first, self._pings, self._is_outdated = number, pings, not has_all
                    self._more = [ping for ping in self._more if ping[2] > number]
                    return
            given = areas, behind, sensors, self._parameters, True
            # Many take as long as some seconds of pings, and few less than to be handed over.
            is_beside = len(behind) > BATCH * TOGETHER
            if is_beside and len(behind) > most:
                return
            most = len(behind) - 1
            areas, has_these = (
                Beside(_with_more, *given).result() if is_beside else _with_more(*given)
            )
            has_all, newest = has_all and has_these, behind[-1][2]

    def renew(self, explain: Callable[[], object]) -> None:
        """Have all pings explained together in a thread beside, unless they are being.

        Parameters
        ----------
        explain : callable
            Does it, and calls `begin`.

        Raises
        ------
        Exception
            What it has raised the last time.
        """

        def work() -> None:
            try:
                explain()
            except Exception as error:
                self._failure = error

        if self._renewal is not None and self._renewal.is_alive():
            return
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure
        self._renewal = threading.Thread(target=work, name=BESIDE, daemon=True)
        self._renewal.start()

    @property
    def is_due(self) -> bool:
        """Whether all pings are to be explained together."""
        with self._lock:
            is_grown = len(self._more) > MORE_SHARE * self._pings
            return self._is_outdated or is_grown or self._pings < FEW_PINGS

    @property
    def is_begun(self) -> bool:
        """Whether there are so many that a map is worth having that they alone tell."""
        with self._lock:
            return self._pings >= FEW_PINGS

    def occupancy_map(
        self, frame_id: str, stamp_ns: int, newest: int, in_time: bool
    ) -> OccupancyMap | None:
        """The map; None if new pings are where nothing is known.

        Parameters
        ----------
        frame_id, stamp_ns
            Of the map.
        newest : int
            Number of the newest ping that is wanted.
        in_time : bool
            Whether new pings where nothing is known may be in a later map, and those beyond the
            first that are explained at once: the stamp is that of the newest ping that is in it.
        """
        with self._making:
            with self._lock:
                known = self._known
                wanted = [ping for ping in self._more if known.newest < ping[2] <= newest]
            if in_time:
                wanted, later = wanted[: BATCH * TOGETHER], wanted[BATCH * TOGETHER :]
                self.is_behind = bool(later)
                stamp_ns = wanted[-1][0].stamp_ns if later else stamp_ns
            areas, last = known.areas, wanted[-1][2] if wanted else known.newest
            drawn = self._drawn
            if drawn is None or drawn.areas is not areas or drawn.newest != last:
                while wanted:
                    size = _batch_of(len(wanted))
                    batch, wanted = wanted[:size], wanted[size:]
                    is_whole = len(batch) >= BATCH
                    # The others are explained anew with those that come.
                    areas = areas if is_whole else list(areas)
                    # One core gains as much as two that wait for each other after each loop.
                    with alone():
                        areas, has_all = _with_more(
                            areas, batch, known.sensors, self._parameters, in_time
                        )
                    if not has_all:
                        if not in_time:
                            return None
                        with self._lock:
                            self._is_outdated = True
                    if is_whole:
                        known = self._took_up(known, batch[-1][2])
                occupancy = drawn_map(areas, self._parameters, known.earlier, frame_id, stamp_ns)
                self._drawn = drawn = _Drawn(known.areas, last, occupancy)
            return replace(copied(drawn.occupancy), frame_id=frame_id, stamp_ns=stamp_ns)

    def _took_up(self, known: _Known, newest: int) -> _Known:
        """What is known after some more pings were added to it, unless others are known now."""
        with self._lock:
            more = known._replace(newest=newest)
            if self._known is known:
                self._known = more
            return more


def _with_more(
    areas: list[AreaState],
    more: list[Numbered],
    sensors: Sensors,
    parameters: MappingParameters,
    telling_alone: bool,
) -> tuple[list[AreaState], bool]:
    """What is known with some more pings, and whether none of them is in no area, or in two.

    Parameters
    ----------
    areas : list of AreaState
        What was known; the list is changed.
    more : list of Numbered
        The pings, which are explained some at a time.
    sensors : Sensors
        What is known of those who heard them.
    parameters : MappingParameters
        Of the map.
    telling_alone : bool
        Whether pings that say again what is known wait until all are explained together.
    """
    has_all = True
    while more:
        size = _batch_of(len(more))
        batch, more = more[:size], more[size:]
        kept = KeptPings(parameters)
        for cone, source, _ in batch:
            kept.add(cone, source)
        for group in kept.islands():
            pings = kept.pings(group, sensors=sensors)
            field = field_around(pings.table, pings.rows, parameters.resolution_m)
            here = [place for place, area in enumerate(areas) if area.overlaps(field)]
            if len(here) != 1:
                has_all = False
                continue
            believed = [areas[here[0]].credit.get(source, 1.0) for source in pings.sources]
            if max(believed) == 0.0:
                continue
            if min(believed) < 1.0:
                pings = kept.pings(group, areas[here[0]].credit, sensors)
            if telling_alone:
                pings, areas[here[0]] = telling(pings, areas[here[0]], parameters)
            if len(pings.rows):
                areas[here[0]] = MorePings(pings, parameters).add_to(areas[here[0]])
    return areas, has_all


def _batch_of(waiting: int) -> int:
    """How many of the pings that wait are explained at once."""
    return min(waiting, BATCH * TOGETHER)
