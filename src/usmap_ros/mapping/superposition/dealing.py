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
    cast_shadows,
    deal_presence,
    deal_proof,
    deal_silence,
)
from usmap_ros.parameters import MappingParameters


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


def rules_of(parameters: MappingParameters) -> Rules:
    """How much of a ping counts by the parameters."""
    bounds = Bounds(
        of_a_bin=parameters.most_evidence_a_bin,
        of_all=parameters.most_evidence,
        forgetting=parameters.forgetting,
    )
    return Rules(
        bounds=bounds,
        proof=parameters.proof_rays,
        trust_m=parameters.silence_trust_m,
        median_power=parameters.reflectivity**2,
    )


@compiled
def look_at(
    look: Look,
    tiles: Tiles,
    all_bins: NDArray[np.int32],
    known: tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]],
    scratch: Scratch,
) -> int:
    """Work out what a look is expected to hear; returns how many cells it sees.

    Parameters
    ----------
    look : Look
        The ping.
    tiles : Tiles
        The grid.
    all_bins : (bins + 1,) int32 array
        0, 1, 2 and so on.
    known : three arrays
        Optical depth of each cell, whether it may hold something, and the power of each quarter.
    scratch : Scratch
        Set.

    Returns
    -------
    count : int
        As many as `scratch` has room for if they do not fit.
    """
    rays, seen, bins, parts = scratch
    depth, among, power = known
    listed = find_cells(look, tiles, among, seen)
    if listed == len(seen.slot):
        return listed
    cast_shadows(look, tiles.resolution_m, seen, listed, depth, rays)
    count = place_cells(look, tiles.resolution_m, all_bins, rays, seen, listed)
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
        After `look_at`.
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
