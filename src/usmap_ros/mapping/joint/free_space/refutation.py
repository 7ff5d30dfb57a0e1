"""What pings refute in cells, and what holds sound back in the others."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.log_odds import over_block
from usmap_ros.mapping.joint.free_space.kinds import ACROSS, ALONG, MIRRORS, ORIENTATIONS
from usmap_ros.mapping.joint.free_space.open_space import MOST_A_SECTOR
from usmap_ros.mapping.joint.free_space.silence import Answers, Silence
from usmap_ros.mapping.joint.free_space.usual_directions import FACES_SO, STANDS, lacks_room
from usmap_ros.mapping.joint.surfaces.lines import drawn, facing_so
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.numerics.arrays import BoolArray, FloatArray, over_last
from usmap_ros.numerics.special import logistic
from usmap_ros.processes.threads import for_each

#: Belief in what is occupied.
OCCUPIED = 0.97
#: Groups of walls that face as most do, and an orientation of each.
USUAL = ((ALONG, 0), (ACROSS, ORIENTATIONS // 2))


class Refutations(NamedTuple):
    """What pings heard of each cell."""

    #: (rows, columns, GROUPS) float32 array: by
    #: `usmap_ros.mapping.joint.free_space.open_space.refute_surfaces`.
    worst: NDArray[np.float32]
    #: (rows, columns) float32 array: pings whose sound is known to have passed it.
    proven: NDArray[np.float32]
    #: (rows, columns) bool array: whether it may not be free.
    closed: BoolArray


class Refuting(NamedTuple):
    """When surfaces are refuted, by silence and by sound that passed through cells."""

    #: (rows, columns) float32 array: pings whose sound is known to have passed each cell.
    proofs: NDArray[np.float32]
    #: What silence has to say, see `usmap_ros.mapping.joint.free_space.silence.Thresholds`: numbers
    #: or (rows, columns) arrays.
    refuted: float | FloatArray
    mirrors_refuted: float | FloatArray
    #: Pings that do, alone.
    enough_proofs: float

    @classmethod
    def by(
        cls, answers: Answers, field: Field, proofs: NDArray[np.float32], enough_proofs: float
    ) -> "Refuting":
        """As a place answers."""
        refuted, of_mirrors = (
            answers.of_cells(field, name) for name in ("refuted", "mirrors_refuted")
        )
        return cls(proofs, refuted, of_mirrors, enough_proofs)

    def by_silence(self) -> "Refuting":
        """The same, whatever passed."""
        return self._replace(proofs=np.zeros_like(self.proofs))

    def each(self, worst: NDArray[np.float32]) -> BoolArray:
        """Whether no surface of each group can stand in a cell: (rows, columns, GROUPS) bool array.

        Each ping whose sound came back through it says an equal part of what silence would have to
        say of mirrors, and is outweighed by echoes in the same way.

        Parameters
        ----------
        worst : (rows, columns, GROUPS) float32 array
            Log-likelihood ratio of a surface in each cell, by `refute_surfaces`.
        """
        said = -self.mirrors_refuted * self.proofs / self.enough_proofs
        fails: BoolArray = worst < (self.refuted + said)[:, :, np.newaxis]
        fails[:, :, MIRRORS] = worst[:, :, MIRRORS] < self.mirrors_refuted + said
        return fails

    def every(self, worst: NDArray[np.float32]) -> BoolArray:
        """Whether no surface of any group can: (rows, columns) bool array."""
        all_fail: BoolArray = over_last(np.logical_and, self.each(worst))
        return all_fail


def beliefs(
    hides: BoolArray, free: BoolArray, worst: NDArray[np.float32], unknown: float | FloatArray
) -> FloatArray:
    """Belief that each cell holds sound back.

    Echoes from one side alone come from anywhere on a ring; what several sides say stands, though
    not surely enough to be shown, explains silence behind it.

    Parameters
    ----------
    hides, free : (rows, columns) bool arrays
        Cells that are occupied, and those that are free.
    worst : (rows, columns, GROUPS) float32 array
        Log-likelihood ratio of a surface in each cell, by `refute_surfaces`.
    unknown : float or (rows, columns) array
        Belief in the others where echoes speak for nothing.
    """
    several = np.maximum(over_last(np.maximum, worst) - MOST_A_SECTOR, 0.0)
    # Of most cells nothing is said, and logarithms take long.
    others, speaks = np.broadcast_to(unknown, several.shape).copy(), several > 0.0
    odds = several[speaks] + np.log(others[speaks] / (1.0 - others[speaks]))
    others[speaks] = logistic(odds)
    others = np.minimum(others, OCCUPIED)
    held: FloatArray = np.where(hides & ~free, OCCUPIED, np.where(free, 0.0, others))
    return held


def refute_for_room(
    is_refuted: BoolArray,
    worst: NDArray[np.float32],
    wanted: BoolArray,
    walls: Walls,
    closed: BoolArray,
    silence: Silence,
    widest: float,
) -> None:
    """Refute walls that face as most do where there is too little room for them.

    Where something may stand they may end, as in the corner to which a wall goes on: the side of an
    alcove was free, for what was known of the wall behind it ended a decimetre before.  And a cell
    or two that are refuted end none: sound that came back past a wall's foot may seem to cross it.

    Parameters
    ----------
    is_refuted : (rows, columns, GROUPS) bool array
        Where no surface of a group can stand; more is added.
    worst : (rows, columns, GROUPS) float32 array
        Log-likelihood ratio of a surface in each cell, by `refute_surfaces`.
    wanted : (2, rows, columns) bool array
        Cells that are asked for, of each of the groups `USUAL`.
    walls : Walls
        What stands.
    closed : (rows, columns) bool array
        Where something may stand whatever is said.
    silence : Silence
        What was learnt of the place.
    widest : float
        Room for a wall of more cells says nothing.
    """

    def refute(part: tuple[BoolArray, tuple[int, int]]) -> None:
        asked, (group, first) = part
        here, said = is_refuted[:, :, group], worst[:, :, group]
        usual = float(silence.kinds[first, 0])
        stands = np.where(walls.shown | closed, np.uint8(STANDS), np.uint8(0))
        stands[drawn(facing_so(walls.all_lines, usual), here.shape)] = FACES_SO
        here |= lacks_room(
            said, _opened(here), asked, stands, usual, silence.long_and_short, silence.refuted,
            widest,
        )  # fmt: skip

    for_each(refute, zip(wanted, USUAL, strict=True))


def _opened(cells: BoolArray) -> BoolArray:
    """Morphological opening: cells of blocks of three by three that are all among some."""
    opened: BoolArray = over_block(~over_block(~cells))
    return opened
