"""Cells that are free by what pings say of them, in rounds: others hold sound back in the next."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.free_space.connected import without_slits
from usmap_ros.mapping.joint.free_space.recesses import may_be_short
from usmap_ros.mapping.joint.free_space.refutation import USUAL, Refuting, refute_for_room
from usmap_ros.mapping.joint.free_space.silence import Answers
from usmap_ros.mapping.joint.free_space.usual_directions import sides, widest_gap_m
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.numerics.arrays import BoolArray, over_last


class Asked(NamedTuple):
    """Cells that may be free: (rows, columns) bool arrays."""

    #: Those that are asked for, where robots stood, and through which sound came back.
    wanted: BoolArray
    stood: BoolArray
    proven: BoolArray
    #: Those that are not free whatever is said, and of them where panes may be.
    closed: BoolArray
    panes: BoolArray
    #: Those behind mirrors that were struck, and not found: there may be room for others.
    behind: BoolArray


def free_now(
    field: Field,
    answers: Answers,
    walls: Walls,
    mirrors: list[MirrorWall],
    cells: Asked,
    refuting: Refuting,
    worst: NDArray[np.float32],
) -> BoolArray:
    """Cells that are free by what is said of them now.

    Parameters
    ----------
    field : Field
        The cells.
    answers, walls
        How the place answers, and what stands.
    mirrors : list of MirrorWall
        Those that were found there.
    cells : Asked
        That are asked for.
    refuting : Refuting
        When surfaces are refuted.
    worst : (rows, columns, GROUPS) float32 array
        Log-likelihood ratio of a surface in each cell, by `refute_surfaces`.
    """
    is_refuted = refuting.each(worst)
    is_refuted |= cells.stood[:, :, np.newaxis]
    if mirrors:
        here, silence = next(answers.each(field))
        widest_cells = widest_gap_m(sides(mirrors)) / field.resolution_m
        asked = cells.wanted & here & ~cells.behind
        wanted = np.array([
            asked & ~may_be_short(field, mirrors, float(silence.kinds[first, 0]), asked)
            for _, first in USUAL
        ])  # fmt: skip
        refute_for_room(is_refuted, worst, wanted, walls, cells.closed, silence, widest_cells)
    free: BoolArray = cells.wanted & over_last(np.logical_and, is_refuted) & ~cells.closed
    free |= cells.stood
    if not mirrors:
        return free
    is_silent = refuting.by_silence().every(worst) | (refuting.proofs == 0.0) | cells.stood
    return without_slits(free, is_silent, field.resolution_m)
