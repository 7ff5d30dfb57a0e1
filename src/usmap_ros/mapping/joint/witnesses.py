"""How far each robot is believed, by who bears it out and who contradicts it.

What a robot claims of a cell, others deny if they looked there and heard nothing, and bear out if
they claim the same beside it.  One that is misplaced, late or loud is contradicted by all who look
at the same things, whereas these bear each other out; one whose heading is wrong contradicts itself
as well.  Some contradiction is usual where walls are smooth or hide one another, and little is
known of who mostly looks where nobody else does.  Who is wrong of two whom nobody else can judge is
not told, and both are believed.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.log_odds import over_block, strength_of
from usmap_ros.mapping.joint.surfaces.mirrors import MirrorWall
from usmap_ros.mapping.joint.surfaces.round_column import RoundColumn, discs
from usmap_ros.mapping.joint.visibility.field import Field
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Parts of a robot's pings that are held against each other; and robots that can contradict.
HALVES, LEAST_WITNESSES = 2, 2
#: Evidence from which on something is claimed or denied, and beyond which it counts no more.
LEAST, MOST = 1.0, 20.0
#: Share that healthy robots bear out, at the least, of what two of them say of the same; and by how
#: much it is more where the rest agree wholly, rather than by such a share.  Of 57 pairs in 19
#: recordings of healthy robots those that share much have 0.26 and more.
USUAL, USUALLY_MORE, WHOLLY = 0.22, 0.22, 0.9
#: Log-likelihood ratio of two who contradict each other wholly, for each share that is usual;
#: bounds of it; and evidence that is worth half of that.
STEEPNESS, BOUNDS, HALF_WORTH = 8.0, (-2.5, 5.0), 20.0
#: Evidence that is believed to agree, and to contradict, before any is there.
BEFORE, BEFORE_AGAINST = 30.0, 20.0
#: Log-odds against a robot's being faulty, before anything is known of it.
HEALTHY = 2.5
#: Probability of being faulty from which on a robot is believed less: of two who contradict each
#: other either has half.  And credit that is none if it is less.
LEAST_CHANCE, LEAST_CREDIT = 0.6, 0.1
TINY = 1e-9
#: Share of a robot's pings from somewhere from which on it is there, and so are the others of them
#: that were sent from beside: nobody knows just where a part of a place begins.
MOSTLY = 0.8
#: Within this distance of a column what is heard may be of it, m.
BESIDE_M = 0.15
#: Evidence of a ping for a smooth thing that it hears just where it is: echoes are as near to it as
#: a twentieth of where else they may be.
OF_A_HIT = 3.0


class MutualEvidence(NamedTuple):
    """What robots say of cells that others speak of, in units of evidence."""

    #: (robots, robots) arrays: of two of them; of one and itself what its halves say of the same.
    agreed: FloatArray
    contradicted: FloatArray

    def shared(self, robot: int) -> float:
        """How much a robot says of what others speak of."""
        others = np.arange(len(self.agreed)) != robot
        return sum(float(sums[robot, others].sum()) for sums in self)

    def borne_out(self, robot: int) -> float:
        """Share of what a robot says that others agree with; 1 if they speak of nothing of it."""
        shared, own = self.shared(robot), float(self.agreed[robot, robot])
        return (float(self.agreed[robot].sum()) - own) / shared if shared else 1.0

    def borne_out_by_themselves(self, *robots: int) -> float:
        """Share of what halves of these robots' pings say that their other halves agree with."""
        agreed, against = (float(np.diag(sums)[list(robots)].sum()) for sums in self)
        return agreed / (agreed + against) if agreed + against else 1.0


def halves_of(sources: Sequence[str], names: Sequence[str]) -> NDArray[np.int64]:
    """Half of whose pings each ping belongs to, of ``HALVES * len(names)``.

    Parameters
    ----------
    sources : sequence of str
        Who heard each ping, in the order of their stamps.
    names : sequence of str
        All of them.
    """
    number = np.array([names.index(source) for source in sources])
    halves = HALVES * number
    for robot in range(len(names)):
        own = np.flatnonzero(number == robot)
        halves[own[len(own) // HALVES :]] += 1
    return halves


def mostly_there(robot: NDArray[np.int64], is_there: BoolArray) -> BoolArray:
    """Whether each ping was sent from somewhere, or its robot is there for the most part.

    Parameters
    ----------
    robot : (pings,) integer array
        Whose each ping is.
    is_there : (pings,) bool array
        Whether each was sent from there.
    """
    share = np.bincount(robot, is_there) / np.maximum(np.bincount(robot), 1)
    return np.asarray(is_there | (share >= MOSTLY)[robot])


def mutual_evidence(
    number: NDArray[np.int32],
    said: NDArray[np.float32],
    field: Field,
    columns: Sequence[RoundColumn] = (),
) -> MutualEvidence:
    """Compare what robots say.

    Parameters
    ----------
    number : (cells,) int32 array
        Cells of which they speak.
    said : (HALVES * robots, 2, cells) array
        What each half of each robot's pings says of them, and of their blocks.
    field : Field
        All cells.
    columns : sequence of RoundColumn
        What is known or suspected to be smooth and round: it answers each side from another place,
        so that nobody is contradicted near it.
    """
    robots = len(said) // HALVES
    is_told = ~discs(list(columns), field, BESIDE_M).ravel()[number]
    whole = said.reshape(robots, HALVES, 2, -1).sum(axis=1)
    claims, beside = _claims(number, np.concatenate([whole, said]), field)
    agreed, contradicted = (np.zeros((robots, robots)) for _ in range(2))
    for one in range(robots):
        first = robots + HALVES * one
        pairs = [(one, other, one, other) for other in range(one)]
        for row, column, a, b in [*pairs, (one, one, first, first + 1)]:
            said_both = [_compared(claims, beside, is_told, *order) for order in ((a, b), (b, a))]
            agreed[row, column] = agreed[column, row] = 0.5 * sum(both for both, _ in said_both)
            against = sum(denied for _, denied in said_both)
            contradicted[row, column] = contradicted[column, row] = against
    return MutualEvidence(agreed, contradicted)


def agreed_on(
    things: Iterable[MirrorWall | RoundColumn], part: NDArray[np.int64], robots: int
) -> FloatArray:
    """What robots agree on by hearing the same smooth things, as in `MutualEvidence`.

    Parameters
    ----------
    things : iterable of MirrorWall or RoundColumn
        Of which cells tell nothing.
    part : (pings,) integer array
        By `halves_of`.
    robots : int
        How many there are.
    """
    agreed = np.zeros((robots, robots))
    for thing in things:
        hits = np.bincount(part[thing.pings], minlength=HALVES * robots).reshape(robots, HALVES)
        both = np.minimum.outer(hits.sum(axis=1), hits.sum(axis=1))
        np.fill_diagonal(both, hits.min(axis=1))
        agreed += OF_A_HIT * both
    return agreed


def _claims(
    number: NDArray[np.int32], said: NDArray[np.float32], field: Field
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Evidence of each cell by each part, and the greatest within two cells of it."""
    claims, beside = (np.empty((len(said), len(number)), np.float32) for _ in range(2))
    for part, own_and_block in enumerate(said):
        grid = np.zeros((2, field.rows * field.columns), np.float32)
        grid[:, number] = own_and_block
        strength = strength_of(*grid.reshape(2, *field.shape))
        claims[part] = strength.ravel()[number]
        beside[part] = over_block(over_block(strength)).ravel()[number]
    return np.clip(claims, -MOST, MOST), np.clip(beside, -MOST, MOST)


def _compared(
    claims: NDArray[np.float32],
    beside: NDArray[np.float32],
    is_told: BoolArray,
    one: int,
    other: int,
) -> tuple[float, float]:
    """How much of what one claims another bears out, and how much it denies where that tells."""
    claimed = np.flatnonzero(claims[one] > LEAST)
    own, near, there = claims[one, claimed], beside[other, claimed], claims[other, claimed]
    is_borne_out, is_denied = near > LEAST, there < -LEAST
    agreed = np.minimum(own, near)[is_borne_out].sum()
    denied = np.minimum(own, -there)[is_denied & ~is_borne_out & is_told[claimed]].sum()
    return float(agreed), float(denied)


def credit(said: MutualEvidence) -> list[float]:
    """How much of the trust in each robot is left, 0 to 1.

    Nobody is faulty, or one, or two are, which is less and less likely beforehand.  Once one is
    found, others may be by what the rest say.
    """
    left, found = list(range(len(said.agreed))), [1.0] * len(said.agreed)
    while len(left) >= LEAST_WITNESSES:
        chances = _chances(said, left)
        worst = int(chances.argmax())
        remains = (1.0 - float(chances[worst])) / (1.0 - LEAST_CHANCE)
        if remains >= 1.0:
            break
        found[left.pop(worst)] = remains if remains >= LEAST_CREDIT else 0.0
    return found


def _chances(said: MutualEvidence, among: list[int]) -> FloatArray:
    """Probability that each of some robots is faulty, by what these say."""
    agreed, contradicted = (sums[np.ix_(among, among)] for sums in said)
    against = np.array([_against(agreed, contradicted, robot) for robot in range(len(among))])
    alone = against.sum(axis=1) - HEALTHY
    # What two have said of each other counts once.
    odds = alone[:, np.newaxis] + alone - 0.5 * (against + against.T)
    np.fill_diagonal(odds, alone)
    greatest = max(0.0, float(odds.max()))
    weights = np.exp(odds - greatest)
    chances: FloatArray = weights.sum(axis=1) / (math.exp(-greatest) + np.triu(weights).sum())
    return chances


def _against(agreed: FloatArray, contradicted: FloatArray, robot: int) -> FloatArray:
    """By how much likelier each other's word, and a robot's own, is if it is faulty."""
    others = np.arange(len(agreed)) != robot
    apart = np.ix_(others, others)
    both, against = (float(np.tril(sums[apart]).sum()) for sums in (agreed, contradicted))
    usual = (both + BEFORE) / (both + against + BEFORE + BEFORE_AGAINST)
    least = USUAL + USUALLY_MORE * max(0.0, (usual - WHOLLY) / (1.0 - WHOLLY))
    said = agreed + contradicted
    total = said[robot]
    share = agreed[robot] / np.maximum(total, TINY)
    ratios = np.clip(STEEPNESS * (1.0 - share / least), *BOUNDS) * total / (total + HALF_WORTH)
    # Who looks at other rooms meets others at walls alone, which look otherwise from either side,
    # or are not known to be in the way.
    own = np.diag(said)
    met = np.minimum(1.0, (said.sum(axis=1) - own) / np.maximum(own, TINY))
    ratios[others] *= np.minimum(met[robot], met[others])
    # That halves of its pings agree does not clear a robot: it may be misplaced throughout.
    ratios[robot] = max(0.0, ratios[robot])
    return np.asarray(ratios)
