"""Leave-one-out: what robots' pings together expect of one robot's, without its own word."""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.extent import check_size
from usmap_ros.mapping.joint.estimate import JointEstimate
from usmap_ros.mapping.joint.forward_model.cell_evidence import no_evidence
from usmap_ros.mapping.joint.forward_model.log_odds import hiding, judged, optical_depth
from usmap_ros.mapping.joint.forward_model.power_estimation import expect_powers
from usmap_ros.mapping.joint.kept_pings import KeptPings, Pings
from usmap_ros.mapping.joint.visibility.field import QUARTERS, field_around
from usmap_ros.mapping.joint.visibility.projection import (
    Projection,
    Scatterers,
    empty_rows,
    project,
)
from usmap_ros.mapping.joint.visibility.ray_casting import cast_rays
from usmap_ros.mapping.joint.visibility.shadows import cast_shadows, faintest_weights
from usmap_ros.mapping.joint.witnesses import (
    HALVES,
    TINY,
    MutualEvidence,
    halves_of,
    mutual_evidence,
)
from usmap_ros.mapping.ping_bins import PingBins
from usmap_ros.mapping.ping_table import NOISE, PingTable, X, Y, ping_in_row
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Evidence from which on others are believed to have seen something.
SEEN = 8.0
#: How far from the mean direction from which others heard it a scatterer is expected to be heard:
#: at least, and so many standard deviations of these directions.  What mirrors is heard from where
#: it is struck squarely alone; poles and rough walls are from any side that anybody has been on.
ASPECT_RAD, ASPECT_STDS = math.radians(15.0), 3.0
#: Rounds of shadows: half of a map's, which settle what is hidden.
ROUNDS = 3


class Expected(NamedTuple):
    """A ping, and what the map that the others made expects of it."""

    #: The ping in bins of range.
    ping_bins: PingBins
    #: (bins,) array: expected power of each range bin, the receiver's noise included.
    power: FloatArray


class LeaveOneOutMap:
    """Joint estimates of all areas, and how much of them each robot speaks for.

    Parameters
    ----------
    cones : mapping of str to sequence of EchoCone
        Pings of each robot that has a part in it; of those from one place few count.
    parameters : MappingParameters
        Of the model.
    """

    def __init__(
        self, cones: Mapping[str, Sequence[EchoCone]], parameters: MappingParameters
    ) -> None:
        self._parameters = parameters
        kept, self._names = kept_pings(cones, parameters), list(cones)
        self._areas = [
            _Area(kept.pings(group), self._names, parameters) for group in kept.islands()
        ]

    def expected(
        self,
        cones: Mapping[str, Sequence[EchoCone]],
        of: Collection[str] | None = None,
        of_one: Callable[[str], Collection[str]] = lambda robot: (robot,),
    ) -> dict[str, list[Expected]]:
        """What the map expects of robots' pings by what the others' pings say.

        Parameters
        ----------
        cones : mapping of str to sequence of EchoCone
            Pings of each robot, which need have no part in the map.
        of : collection of str, optional
            The robots that are asked about; all of them by default.
        of_one : callable
            All names of a robot, none of which has a word in what is expected of it.
        """
        found: dict[str, list[Expected]] = {}
        for robot in cones if of is None else of:
            pings = kept_pings({robot: cones[robot]}, self._parameters).pings()
            ahead = self.levels(pings.rows, pings.table, of_one(robot))
            found[robot] = []
            for index, row in enumerate(pings.rows.tolist()):
                ping_bins = ping_in_row(pings.table, row)
                bins = slice(len(ping_bins.kind))
                found[robot].append(Expected(ping_bins, ahead[index, bins]))
        return found

    def mutual_evidence(self) -> MutualEvidence:
        """What robots say of cells that others speak of, in all areas."""
        shape = (-1, 2, len(self._names), len(self._names))
        return MutualEvidence(
            *np.reshape([area.mutual_evidence() for area in self._areas], shape).sum(axis=0)
        )

    def levels(
        self, rows: NDArray[np.int64], table: PingTable, without: Collection[str]
    ) -> FloatArray:
        """Expected power of each range bin of some pings, (pings, bins).

        Parameters
        ----------
        rows : (pings,) integer array
            Which ones.
        table : PingTable
            The pings.
        without : collection of str
            Robots whose word does not count.
        """
        noise = table.numbers[rows, NOISE, np.newaxis]
        levels = np.repeat(noise, table.kind.shape[1], axis=1)
        for area in self._areas:
            inside = area.may_reach(table, rows)
            if inside.any():
                heard = area.expect(table, rows[inside], frozenset(without))
                levels[inside] += heard - noise[inside]
        return levels


class _Believed(NamedTuple):
    """Scatterers of an area, their powers, and the optical depth of its cells."""

    scatterers: Scatterers
    power: NDArray[np.float32]
    depth: NDArray[np.float32]
    #: (scatterers,) arrays: where the cell of each is, m, from which direction it was heard, a unit
    #: vector, and the cosine of how far off that it is expected to be heard.
    x_m: FloatArray
    y_m: FloatArray
    toward_x: FloatArray
    toward_y: FloatArray
    least_cosine: FloatArray

    def is_askew(self, pairs: Projection, table: PingTable, rows: NDArray[np.int64]) -> BoolArray:
        """Whether nobody has heard the scatterer of each pair from where its ping is from."""
        scatterer = pairs.scatterer[: pairs.start[-1]]
        numbers = table.numbers[np.repeat(rows, np.diff(pairs.start))]
        to_x, to_y = numbers[:, X] - self.x_m[scatterer], numbers[:, Y] - self.y_m[scatterer]
        along = to_x * self.toward_x[scatterer] + to_y * self.toward_y[scatterer]
        askew: BoolArray = along < self.least_cosine[scatterer] * np.hypot(to_x, to_y)
        return askew


class _Area:
    """One joint estimate; parameters are as in `LeaveOneOutMap`."""

    def __init__(self, pings: Pings, names: Sequence[str], parameters: MappingParameters) -> None:
        self._opacity = parameters.shadow_opacity
        self._field = field_around(pings.table, pings.rows, parameters.resolution_m)
        check_size(self._field.rows - 2, self._field.columns - 2, parameters)
        self._estimate = JointEstimate(
            pings.table, pings.rows, pings.weights, pings.echoes, self._field, self._opacity
        )
        self._estimate.estimate_powers(ROUNDS)
        self._names = names
        weighed, halves = self._estimate.weighed, halves_of(pings.sources, names)
        self._cells = weighed.number
        self._said = weighed.evidence_of_parts(halves, HALVES * len(names))
        self._aspects = weighed.aspects_of_parts(halves, HALVES * len(names))
        self._believed: dict[frozenset[str], _Believed] = {}

    def mutual_evidence(self) -> MutualEvidence:
        """What robots say of its cells, beside one another."""
        return mutual_evidence(self._cells, self._said, self._field)

    def may_reach(self, table: PingTable, rows: NDArray[np.int64]) -> BoolArray:
        """Whether pings may hear of the area."""
        field, numbers = self._field, table.numbers[rows]
        column, row = (numbers[:, axis] / field.resolution_m for axis in (X, Y))
        is_beside: BoolArray = (column >= field.first_column) & (row >= field.first_row)
        is_before = (column < field.first_column + field.columns) & (
            row < field.first_row + field.rows
        )
        return is_beside & is_before

    def expect(
        self, table: PingTable, rows: NDArray[np.int64], without: frozenset[str]
    ) -> FloatArray:
        """Expected power of each range bin of some pings, by what all but some robots say."""
        if without not in self._believed:
            self._believed[without] = self._without(without)
        believed = self._believed[without]
        power, depth = believed.power, believed.depth
        expected = np.ones((len(rows), table.kind.shape[1]), np.float32)
        pairs = project(table, rows, self._field, believed.scatterers)
        pairs.weight[: pairs.start[-1]][believed.is_askew(pairs, table, rows)] = 0.0
        heard = empty_rows(int(pairs.start[-1]) + 1, np.zeros_like(pairs.start))
        left = cast_rays(table, rows, self._field, depth)
        every = np.arange(len(power), dtype=np.int32)
        cast_shadows(pairs, every, power, left, faintest_weights(table, rows), heard)
        expect_powers(table, rows, heard, power, expected)
        return expected.astype(float)

    def _without(self, robots: frozenset[str]) -> _Believed:
        """What others' evidence speaks for."""
        others, shape = no_evidence(self._field), self._field.shape
        count = np.repeat([name not in robots for name in self._names], HALVES)
        others.own[self._cells], others.block[self._cells] = self._said[count].sum(axis=0)
        seen = np.repeat((judged(others, shape) > SEEN).ravel(), QUARTERS)
        quarters = np.flatnonzero(seen & (self._estimate.power > 0.0))
        cell, part = np.divmod(quarters, QUARTERS)
        scatterers = Scatterers(cell.astype(np.int32), part.astype(np.uint8))
        depth = optical_depth(hiding(others, shape, np.zeros(shape, bool)), self._opacity)
        x_m, y_m = self._field.geometry().cell_centers_m(*np.divmod(cell, self._field.columns)).T
        support, x, y = self._aspects[count].sum(axis=0)[:, np.searchsorted(self._cells, cell)]
        length = np.maximum(np.hypot(x, y), TINY)
        # Standard deviation of directions, by the length of their mean (Mardia & Jupp 2000, 2.3.5).
        std_rad = np.sqrt(-2.0 * np.log(np.clip(length / np.maximum(support, TINY), TINY, 1.0)))
        return _Believed(
            scatterers, self._estimate.power[quarters], depth, x_m, y_m,
            x / length, y / length,
            np.cos(np.minimum(ASPECT_RAD + ASPECT_STDS * std_rad, math.pi)),
        )  # fmt: skip


def kept_pings(cones: Mapping[str, Sequence[EchoCone]], parameters: MappingParameters) -> KeptPings:
    """Robots' pings as an estimate takes them, in the order of their stamps.

    Parameters
    ----------
    cones : mapping of str to sequence of EchoCone
        Of each robot.
    parameters : MappingParameters
        Of the model.
    """
    kept = KeptPings(parameters)
    together = [(cone, robot) for robot, own in cones.items() for cone in own]
    for cone, robot in sorted(together, key=lambda each: (each[0].stamp_ns, each[1])):
        kept.add(cone, robot)
    return kept
