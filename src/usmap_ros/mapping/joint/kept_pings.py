"""The pings that a joint estimate is made from: looks from one place are one look."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.islands import joined, squares_of
from usmap_ros.mapping.joint.sensors import Sensors, sensors_of
from usmap_ros.mapping.joint.thinning import Thinning
from usmap_ros.mapping.joint.visibility.echoes import Echoes
from usmap_ros.mapping.ping_table import PingTable, ping_table_of
from usmap_ros.numerics.arrays import BoolArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Pings from within such a step of position, and of heading, look from one place.
STEP_M, STEP_RAD = 0.02, math.radians(2.0)
#: So many of them are kept, the newest: what is moving is seen by them.
MOST_FROM_A_PLACE = 4

#: Where a ping looks from, and with what: in steps.
Place = tuple[str, str, int, int, int, int]
#: Pings by which each robot is judged: the latest ones.
REMEMBERED = 200
#: Pings that are pickled together, which takes some ms.
PICKLED_TOGETHER = 64
_ALL_BELIEVED: Mapping[str, float] = MappingProxyType({})


class Pings(NamedTuple):
    """Pings as an estimate takes them, in the order of their stamps."""

    #: In range bins.
    table: PingTable
    #: (pings,) integer array: which of its rows.
    rows: NDArray[np.int64]
    #: (pings,) float32 array: how much each counts: those from one place count as one, of those who
    #: are trusted.
    weights: NDArray[np.float32]
    #: Of each.
    echoes: Echoes
    #: (pings,) bool array: whether their sensors report the first thing only, from whichever side
    #: it is looked at.
    first_only: BoolArray
    #: Who heard each.
    sources: list[str]

    def among(self, which: NDArray[np.int64]) -> Pings:
        """Some of them, in the same table.

        Parameters
        ----------
        which : (pings,) int64 array
            Places among these, in ascending order.
        """
        return Pings(
            self.table, self.rows[which], self.weights[which], self.echoes.of_pings(which),
            self.first_only[which], [self.sources[place] for place in which.tolist()],
        )  # fmt: skip


class KeptPings:
    """Recent pings, so few from each place that a robot that stands still adds none.

    Parameters
    ----------
    parameters : MappingParameters
        Of their range bins.
    """

    def __init__(self, parameters: MappingParameters) -> None:
        self._parameters = parameters
        self._cones: list[tuple[EchoCone, str, Place]] = []
        self._at: dict[Place, int] = {}
        # As far as that was asked since pings changed.
        self._sensors: Sensors | None = None
        #: How much each source's pings count, where that is less than wholly: 0 to 1.
        self.trust: dict[str, float] = {}
        self._thinning = Thinning()
        # Since when pings of these are doubtful.
        self._doubtful_since_ns: dict[str, int] = {}

    def __len__(self) -> int:
        return len(self._cones)

    def __getstate__(self) -> dict[str, Any]:
        """All of it, the pings pickled few at a time: no other thread waits for all of them."""
        some = range(0, len(self), PICKLED_TOGETHER)
        pickled = [pickle.dumps(self._cones[first : first + PICKLED_TOGETHER]) for first in some]
        return vars(self) | {"_cones": pickled}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._cones = [each for some in state["_cones"] for each in pickle.loads(some)]

    @property
    def memory_bytes(self) -> int:
        """Memory that their numbers take."""
        return sum(16 * len(cone.ranges_m) + len(cone.detection_limits) for cone, *_ in self._cones)

    def add(self, cone: EchoCone, source: str) -> bool:
        """Take up a ping; one from the same place goes, if there are enough.

        Returns
        -------
        is_new : bool
            Whether it is the only one from there.
        """
        place = _place(cone, source)
        self._at[place] = self._at.get(place, 0) + 1
        if self._at[place] > MOST_FROM_A_PLACE:
            oldest = next(i for i, kept in enumerate(self._cones) if kept[2] == place)
            self._remove(oldest)
        self._cones.append((cone, source, place))
        self._sensors = None
        return self._at[place] == 1

    def sensors(self) -> Sensors:
        """What is known of the sensors, by what those heard who are believed at all."""
        if self._sensors is None:
            believed = [each for each in self.cones() if self.is_believed(each[1])]
            self._sensors = sensors_of(believed, self._parameters.correct_common_errors)
        return self._sensors

    def copy(self) -> KeptPings:
        """The same pings; neither changes with the other."""
        other = KeptPings(self._parameters)
        other._cones, other._at = self._cones.copy(), self._at.copy()
        other.trust = self.trust.copy()
        other._doubtful_since_ns = self._doubtful_since_ns.copy()
        return other

    def cones(self) -> Iterator[tuple[EchoCone, str]]:
        """All of them, each with its source, in the order in which they came."""
        return ((cone, source) for cone, source, _ in self._cones)

    def drop_oldest(self, count: int) -> None:
        """Let the oldest go."""
        for _ in range(count):
            self._remove(0)
        self._thinning.let_go(count)

    def thin(self) -> int:
        """Let a share of the pings of each time go; returns how many went."""
        going = self._thinning.going(len(self))
        for index in going[::-1].tolist():
            self._remove(index)
        return len(going)

    def drop_newest(self) -> None:
        """Let the one go that came last."""
        self._remove(len(self) - 1)

    def leave_out(self, is_left_out: Callable[[str], bool]) -> int:
        """Let those of some sources go; returns how many there were."""
        before = len(self)
        for index in range(before - 1, -1, -1):
            if is_left_out(self._cones[index][1]):
                self._remove(index)
        return before - len(self)

    def is_believed(self, source: str) -> bool:
        """Whether what a source says counts at all."""
        return self.trust.get(source, 1.0) > 0.0

    def believe(self, shares: Mapping[str, float]) -> bool:
        """Let some sources' pings count for less.

        Those that a source was doubted for go if it is found to be right again: it is not for
        these that it is.

        Parameters
        ----------
        shares : mapping of str to float
            How much of what each says counts, as it was found, 0 to 1; of all others nothing is
            known, and they count wholly.

        Returns
        -------
        has_changed : bool
            Whether that is otherwise than before.
        """
        less = {source: share for source, share in shares.items() if share < 1.0}
        if less == self.trust:
            return False
        for source in less.keys() - self.trust.keys():
            stamps_ns = [cone.stamp_ns for cone, whose, _ in self._cones if whose == source]
            if stamps_ns:
                self._doubtful_since_ns[source] = sorted(stamps_ns)[-REMEMBERED:][0]
        for source in self._doubtful_since_ns.keys() - less.keys():
            since_ns = self._doubtful_since_ns.pop(source)
            if source in shares:
                self._drop_since(source, since_ns)
        self.trust, self._sensors = less, None
        return True

    def _drop_since(self, source: str, since_ns: int) -> None:
        for index in range(len(self) - 1, -1, -1):
            cone, whose, _ = self._cones[index]
            if whose == source and cone.stamp_ns >= since_ns:
                self._remove(index)

    def islands(self) -> list[list[int]]:
        """Indices of pings, divided into groups that cannot see the same cells.

        Each group is a problem of its own, so that areas far apart cost what they hold.  Pings of
        sources that are not believed at all are in none.
        """
        counts = np.array([self.is_believed(source) for _, source, _ in self._cones], bool)
        if not counts.any():
            return []
        counted = np.flatnonzero(counts)
        # Robots that stay in a place reach the same squares again and again.
        squares, which = np.unique(
            [squares_of(self._cones[index][0]) for index in counted], axis=0, return_inverse=True
        )
        group_of = joined(squares)[which.reshape(-1)]
        groups = [counted[group_of == group].tolist() for group in range(group_of.max() + 1)]
        return sorted(groups)

    def pings(
        self,
        among: list[int] | None = None,
        credit: Mapping[str, float] = _ALL_BELIEVED,
        sensors: Sensors | None = None,
    ) -> Pings:
        """Them, or some of them, as an estimate takes them.

        Robots' pings come in one order today and in another tomorrow: that of stamps stays.

        Parameters
        ----------
        among : list of int, optional
            Which.
        credit : mapping of str to float
            How much of the trust in each source is left here, where that is less than all of it.
        sensors : Sensors, optional
            As in `sensors`, if more pings than these have told.
        """
        kept = self._cones if among is None else [self._cones[index] for index in among]
        kept = [each for each in kept if credit.get(each[1], 1.0) > 0.0]
        kept = sorted(kept, key=lambda each: (each[0].stamp_ns, *each[2]))
        sensors = self.sensors() if sensors is None else sensors
        kept = [(sensors.heard(cone, source), source, place) for cone, source, place in kept]
        ranges_m = [np.asarray(cone.ranges_m, np.float64) for cone, *_ in kept]
        amplitudes = [np.asarray(cone.amplitudes, np.float64) for cone, *_ in kept]
        start = np.concatenate([[0], np.cumsum([len(ranges) for ranges in ranges_m])])
        trust = {
            source: self.trust.get(source, 1.0) * credit.get(source, 1.0) for _, source, _ in kept
        }
        weights = [trust[source] / self._at[place] for _, source, place in kept]
        return Pings(
            ping_table_of([cone for cone, *_ in kept], self._parameters),
            np.arange(len(kept)),
            np.array(weights, np.float32),
            Echoes(start.astype(np.int64), np.concatenate(ranges_m), np.concatenate(amplitudes)),
            np.array([cone.child_frame_id in sensors.first_only for cone, *_ in kept], bool),
            [source for _, source, _ in kept],
        )

    def _remove(self, index: int) -> None:
        _, _, place = self._cones.pop(index)
        self._sensors = None
        self._at[place] -= 1
        if not self._at[place]:
            del self._at[place]


def _place(cone: EchoCone, source: str) -> Place:
    """Where a ping looks from, in steps as large as the pose is uncertain."""
    x, y, yaw = cone.pose.planar_variances
    step_m = max(STEP_M, math.sqrt(0.5 * (x + y)))
    step_rad = max(STEP_RAD, math.sqrt(yaw))
    x_m, y_m, z_m = cone.pose.position_m.tolist()
    return (
        source, cone.child_frame_id, round(x_m / step_m), round(y_m / step_m), round(z_m / step_m),
        round(cone.pose.yaw_rad / step_rad),
    )  # fmt: skip
