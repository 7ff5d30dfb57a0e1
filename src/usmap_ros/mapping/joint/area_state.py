"""What is known of an area: from it an estimate goes on when more pings come."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.mapping.joint.forward_model.log_odds import NOTHING
from usmap_ros.mapping.joint.forward_model.power_estimation import PowerLimits
from usmap_ros.mapping.joint.forward_model.powers import Settled
from usmap_ros.mapping.joint.free_space.kinds import GROUPS
from usmap_ros.mapping.joint.free_space.silence import Answers
from usmap_ros.mapping.joint.looks import Looks
from usmap_ros.mapping.joint.surfaces.smooth_surfaces import KnownSurfaces
from usmap_ros.mapping.joint.visibility.field import QUARTERS, Field
from usmap_ros.numerics.arrays import BoolArray, FloatArray


class CellStates(NamedTuple):
    """What is known of cells; (rows, columns, …) arrays."""

    #: Of their quarters, as in `usmap_ros.mapping.joint.forward_model.powers.Settled`.
    power: NDArray[np.float32]
    firmness: NDArray[np.float32]
    #: As in `usmap_ros.mapping.joint.forward_model.cell_evidence.CellEvidence`.
    own: NDArray[np.float32]
    block: NDArray[np.float32]
    heard: NDArray[np.float32]
    axis_cos: NDArray[np.float32]
    axis_sin: NDArray[np.float32]
    from_x: NDArray[np.float32]
    from_y: NDArray[np.float32]
    crowd: NDArray[np.float32]
    asked: NDArray[np.float32]
    #: Belief that each hides what is behind it.
    hiding: FloatArray
    #: As in `usmap_ros.mapping.joint.free_space.refutation.Refutations`.
    worst: NDArray[np.float32]
    proven: NDArray[np.float32]
    closed: BoolArray
    #: What is free.
    free: BoolArray
    #: What is shown, as in `usmap_ros.mapping.joint.surfaces.walls.Walls`.
    occupied: BoolArray
    filled: BoolArray
    #: What was occupied before any of the pings.
    standing: BoolArray
    #: Log-odds that each holds or touches a surface.
    belief: FloatArray

    @property
    def settled(self) -> Settled:
        """Powers of quarters, one behind the other."""
        return Settled(self.power.ravel(), self.firmness.ravel())

    @property
    def evidence(self) -> CellEvidence:
        """Of cells, one behind the other."""
        return CellEvidence(**{name: getattr(self, name).ravel() for name in CellEvidence._fields})

    @property
    def shown(self) -> BoolArray:
        """All that is occupied."""
        return self.occupied | self.filled


@dataclass(frozen=True)
class AreaState:
    """What is known of an area; nothing changes its arrays, which others may have, too."""

    #: Its cells.
    field: Field
    #: Of each of them.
    cells: CellStates
    #: Its mirrors and columns.
    smooth: KnownSurfaces
    #: Powers that are of interest there.
    limits: PowerLimits
    #: How it answers.
    answers: Answers
    #: How much of the trust in each source is left there.
    credit: Mapping[str, float]
    #: From which sides it was looked at.
    looks: Looks

    def overlaps(self, field: Field) -> bool:
        """Whether any cell of a field is one of these."""
        own = self.field
        return (
            own.first_row < field.first_row + field.rows
            and field.first_row < own.first_row + own.rows
            and own.first_column < field.first_column + field.columns
            and field.first_column < own.first_column + own.columns
        )

    def reaching(self, field: Field) -> AreaState:
        """The same, or where that does not hold a field, the same of one that holds both."""
        own = self.field
        bottom, left = (
            min(own.first_row, field.first_row), min(own.first_column, field.first_column)
        )  # fmt: skip
        top = max(own.first_row + own.rows, field.first_row + field.rows)
        right = max(own.first_column + own.columns, field.first_column + field.columns)
        whole = Field(bottom, left, top - bottom, right - left, own.resolution_m)
        return self if whole == own else self._on(whole)

    def _on(self, whole: Field) -> AreaState:
        """The same on a field around this one."""
        larger = _nothing(whole, self.answers)
        _put(larger, whole, self.cells, self.field)
        return replace(self, field=whole, cells=larger)

    def part(self, field: Field) -> CellStates:
        """What is known of the cells of a field within this one, in the same arrays."""
        place = _place(field, self.field)
        parts: list[Any] = [values[place] for values in self.cells]
        return CellStates(*parts)

    def with_part(self, cells: CellStates, field: Field) -> AreaState:
        """The same with something else known of the cells of a field within this one."""
        if field == self.field:
            return replace(self, cells=cells)
        place = _place(field, self.field)

        def put(old: Any, new: Any) -> Any:
            # What is as `part` gave it stays.
            if new.base is old:
                return old
            whole = old.copy()
            whole[place] = new
            return whole

        return replace(self, cells=CellStates(*map(put, self.cells, cells)))


def _place(field: Field, whole: Field) -> tuple[slice, slice]:
    """Where the cells of a field are in the arrays of one around it."""
    row, column = field.first_row - whole.first_row, field.first_column - whole.first_column
    return slice(row, row + field.rows), slice(column, column + field.columns)


def _put(into: CellStates, whole: Field, cells: CellStates, field: Field) -> None:
    place = _place(field, whole)
    pairs: Iterable[Any] = zip(into, cells, strict=True)
    for old, new in pairs:
        old[place] = new


def _nothing(field: Field, answers: Answers) -> CellStates:
    """What is known of cells that no ping has reached."""
    worst = np.full((*field.shape, GROUPS), np.finfo(np.float32).min, np.float32)
    for here, silence in answers.each(field):
        usual = np.full(GROUPS, -np.inf)
        np.maximum.at(usual, silence.kinds[:, 2].astype(np.int64), silence.kinds[:, 1])
        worst[here] = np.maximum(worst[here], usual)
    begin: dict[str, Any] = {"worst": worst, "belief": NOTHING}
    kinds_of: dict[str, Any] = {"hiding": np.float64, "belief": np.float64}
    kinds_of |= dict.fromkeys(("closed", "free", "occupied", "filled", "standing"), bool)
    depths = {"power": (QUARTERS,), "firmness": (QUARTERS,), "worst": (GROUPS,)}
    nothing: list[Any] = [
        np.full((*field.shape, *depths.get(name, ())), begin.get(name, 0), kinds_of.get(name, "f4"))
        for name in CellStates._fields
    ]
    return CellStates(*nothing)


def least_credit(areas: Iterable[AreaState]) -> dict[str, float]:
    """How much of the trust in each source is left where least is, if that is not all of it."""
    found: dict[str, float] = {}
    for area in areas:
        for source, credit in area.credit.items():
            if credit < found.get(source, 1.0):
                found[source] = credit
    return dict(sorted(found.items()))
