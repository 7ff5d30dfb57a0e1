"""Cells that are shown as occupied, and the lines that they are on."""

from dataclasses import dataclass, replace

import numpy as np

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.mapping.joint.surfaces.lines import (
    BEGIN,
    END,
    drawn,
    middles_in,
    off_line,
    without_askew,
    without_doubles,
)
from usmap_ros.mapping.joint.surfaces.smooth_surfaces import SmoothSurfaces
from usmap_ros.mapping.joint.surfaces.surface_lines import (
    ON_LINE_CELLS,
    surface_lines,
    without_arcs,
)
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.special import running_maximum

#: Log-odds from which on a cell is shown as occupied, and from which on it is where a line goes
#: through it.
SHOWN, ON_A_LINE = 0.62, 0.0
#: Ghosts lie beside a line, so many cells off it, and are so much less certain than its cells,
#: which are as certain as this if there are none.
BESIDE_CELLS, GHOST_MARGIN, USUAL = 4.0, 1.5, 2.0
#: Where there are no lines, cells so near to one that is by so much more certain are of the same
#: point, heard from where poses or ranges are a little off.
POINT_CELLS, POINT_MARGIN = 2, 0.3


@dataclass(frozen=True)
class Walls:
    """Cells that are shown as occupied, and the lines that they are on."""

    #: (rows, columns) bool arrays: cells by their own evidence, and cells that lines and columns go
    #: through.
    occupied: BoolArray
    filled: BoolArray
    #: (rows, columns) bool array: those of the latter that nothing but a line through believed
    #: cells speaks for.
    bridged: BoolArray
    #: (lines, 5) arrays: see `usmap_ros.mapping.joint.surfaces.lines`.
    lines: FloatArray
    mirrors: FloatArray

    @property
    def all_lines(self) -> FloatArray:
        """Lines of both kinds."""
        return np.concatenate([self.lines, self.mirrors])

    def through(self, lines: FloatArray, stood: BoolArray) -> "Walls":
        """With longer lines of the first kind.

        Parameters
        ----------
        lines : (lines, 5) array
            Instead of those that there are.
        stood : (rows, columns) bool array
            Where robots stood, and so nothing else.
        """
        added = drawn(lines, self.filled.shape) & ~self.shown & ~stood
        return replace(self, filled=self.filled | added, bridged=self.bridged | added, lines=lines)

    def without(self, refuted: BoolArray) -> "Walls":
        """All but some cells that nothing but a line speaks for.

        Parameters
        ----------
        refuted : (rows, columns) bool array
            Cells in which hardly a surface can stand.
        """
        gaps = self.bridged & refuted
        return replace(self, filled=self.filled & ~gaps, bridged=self.bridged & ~gaps)

    def within(self, cells: BoolArray) -> "Walls":
        """What of them is in some cells; lines if their middles are.

        Parameters
        ----------
        cells : (rows, columns) bool array
            The cells.
        """
        return Walls(
            self.occupied & cells, self.filled & cells, self.bridged & cells,
            middles_in(self.lines, cells), middles_in(self.mirrors, cells),
        )  # fmt: skip

    @property
    def shown(self) -> BoolArray:
        """All that is occupied."""
        return self.occupied | self.filled


def find_walls(
    log_odds: FloatArray,
    evidence: CellEvidence,
    field: Field,
    gap_m: float,
    smooth: SmoothSurfaces,
    stood: BoolArray,
) -> Walls:
    """Cells that are shown, and lines through them.

    Parameters
    ----------
    log_odds : (rows, columns) array
        Of each cell.
    evidence : CellEvidence
        From where they were heard.
    field : Field
        The cells.
    gap_m : float
        Widest gap in a run of believed cells that counts as wall; 0: nothing is filled.
    smooth : SmoothSurfaces
        Mirrors and columns.
    stood : (rows, columns) bool array
        Where robots stood, and so nothing else.
    """
    believed = log_odds > ON_A_LINE
    lines = without_doubles(surface_lines(log_odds, believed, gap_m / field.resolution_m))
    lines = without_askew(without_arcs(lines, believed, evidence), smooth.usual_lines())
    mirrors = smooth.lines()
    rows, columns = np.nonzero(believed)
    certain = log_odds[rows, columns]
    is_kept, is_ghost = (np.zeros(len(rows), bool) for _ in range(2))
    are_alone = not len(lines) and not len(mirrors)
    if are_alone:
        width = 2 * POINT_CELLS + 1
        most = running_maximum(running_maximum(log_odds, width).T, width).T
        is_ghost = certain < most[rows, columns] - POINT_MARGIN
    for line in np.concatenate([lines, mirrors]):
        across, along = off_line(line, rows, columns)
        beside = (along >= line[BEGIN] - 1.0) & (along <= line[END] + 1.0)
        on = beside & (np.abs(across) <= ON_LINE_CELLS)
        usual = float(np.median(certain[on])) if on.any() else USUAL
        off = beside & ~on & (np.abs(across) <= BESIDE_CELLS)
        is_kept |= on
        is_ghost |= off & (certain < usual + GHOST_MARGIN)
    alone = np.flatnonzero((certain > SHOWN) & ~is_ghost & ~is_kept)
    is_kept[alone[~smooth.hide(rows[alone], columns[alone])]] = True
    occupied = np.zeros(field.shape, bool)
    occupied[rows[is_kept], columns[is_kept]] = True
    occupied &= ~stood
    smoothly = drawn(mirrors, field.shape) | smooth.drawn_columns()
    if are_alone:
        smoothly |= smooth.drawn_points()
    filled = (drawn(lines, field.shape) | smoothly) & ~stood
    return Walls(occupied, filled, filled & ~smoothly & ~occupied, lines, mirrors)
