"""A visit to a ping: what the map expects of it, and what it says of the map.

Each is one call, because from Python it takes as long to hand over the arrays as to work on them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.compiled import compiled
from usmap_ros.mapping.superposition.cells import Tiles
from usmap_ros.mapping.superposition.evidence import (
    Bounds,
    Evidence,
    add_evidence,
    prepare_bins,
    prove_rays,
)
from usmap_ros.mapping.superposition.learning import Powers, learn_powers, weigh_bins
from usmap_ros.mapping.superposition.look import Look
from usmap_ros.mapping.superposition.powers import Bins, Contributions, expect
from usmap_ros.mapping.superposition.seen import Rays, Seen, find_cells, place_cells
from usmap_ros.mapping.superposition.shares import Shares, add_shares
from usmap_ros.mapping.superposition.sight import (
    cast_rays,
    deal_presence,
    deal_proof,
    deal_silence,
)


class Scratch(NamedTuple):
    """Room for one visit.

    Parameters
    ----------
    rays : Rays
        Of the look.
    seen : Seen
        Cells that it sees.
    bins : Bins
        Its range bins.
    parts : Contributions
        What is expected of the cells in them.
    """

    rays: Rays
    seen: Seen
    bins: Bins
    parts: Contributions


class Said(NamedTuple):
    """What pings say of cells.

    Parameters
    ----------
    evidence : Evidence
        For and against them.
    shares : Shares
        Theirs in what was heard.
    """

    evidence: Evidence
    shares: Shares


class Rules(NamedTuple):
    """How much of a ping counts.

    Parameters
    ----------
    bounds : Bounds
        Of its evidence.
    proof : float
        Rays that prove that a cell is clear.
    trust_m : float
        How far silence is trusted where nothing has proven that the way is open.
    median_power : float
        Power that an object scatters.
    """

    bounds: Bounds
    proof: float
    trust_m: float
    median_power: float


@compiled
def look_around(
    look: Look,
    tiles: Tiles,
    depth: NDArray[np.float32],
    among: NDArray[np.float32],
    rays: Rays,
    seen: Seen,
) -> int:
    """Cast a look's rays, and list the cells in its cone that are not 0 in `among`."""
    cast_rays(look, tiles, depth, rays)
    return find_cells(look, tiles, among, seen)


@compiled
def expect_listed(
    look: Look,
    res: float,
    all_bins: NDArray[np.int32],
    listed: int,
    power: NDArray[np.float32],
    scratch: Scratch,
) -> int:
    """Work out what is expected of the cells listed; returns how many of them the look sees."""
    rays, seen, bins, parts = scratch
    count = place_cells(look, res, all_bins, rays, seen, listed)
    expect(look, seen, count, power, parts, bins)
    return count


@compiled
def learn(look: Look, count: int, powers: Powers, least_news: float, scratch: Scratch) -> None:
    """Move the powers of the cells that a look sees towards what explains it."""
    weigh_bins(look, scratch.bins)
    learn_powers(look, scratch.seen, count, scratch.bins, powers, least_news)


@compiled
def deal(
    look: Look,
    tiles: Tiles,
    count: int,
    believed: tuple[NDArray[np.float32], NDArray[np.float32]],
    rules: Rules,
    scratch: Scratch,
    said: Said,
) -> None:
    """Add what a look says of cells, and of the way to them.

    Parameters
    ----------
    look : Look
        The ping.
    tiles : Tiles
        The grid.
    count : int
        Number of cells that it sees.
    believed : two (slots,) float32 arrays
        Log-odds of each cell, and rays known to have passed it.
    rules : Rules
        How much counts.
    scratch : Scratch
        After `expect_listed`.
    said : Said
        Added to.
    """
    rays, seen, bins, parts = scratch
    belief, passed = believed
    prepare_bins(look, bins)
    add_evidence(look, seen, count, bins, parts, tiles, rules.bounds, said.evidence)
    add_shares(look, seen, count, bins, parts, said.shares)
    prove_rays(look, seen, count, bins, parts, belief, tiles, rays.proven_m)
    deal_proof(look, tiles, rays, said.evidence.clear)
    deal_presence(look, tiles, rules.proof, rules.bounds, said.evidence)
    deal_silence(
        look, tiles, rays, passed, rules.proof, rules.trust_m, rules.median_power,
        said.evidence.silent,
    )  # fmt: skip
