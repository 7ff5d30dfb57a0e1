"""A visit to a ping: what the map expects of it, and what it says of the map.

Each is one call, because from Python it takes as long to hand over the arrays as to work on them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from usmap_ros.mapping.superposition.window import Looks, look_in
from usmap_ros.numerics.compiled import compiled, compiled_within
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


class Believed(NamedTuple):
    """What is known of the cells of the map; (slots,) float32 arrays.

    Parameters
    ----------
    depth : float32 array
        Optical depth.
    log_odds : float32 array
        That a cell holds something.
    passed : float32 array
        Rays known to have passed it.
    """

    depth: NDArray[np.float32]
    log_odds: NDArray[np.float32]
    passed: NDArray[np.float32]


@compiled
def look_at(
    look: Look,
    tiles: Tiles,
    depth: NDArray[np.float32],
    among: NDArray[np.float32],
    power: NDArray[np.float32],
    scratch: Scratch,
) -> int:
    """Work out what a look is expected to hear; returns how many cells it sees.

    Parameters
    ----------
    look : Look
        The ping.
    tiles : Tiles
        The grid.
    depth : (slots,) float32 array
        Optical depth of each cell.
    among : (slots,) float32 array
        Above 0 for cells that may hold something, 0 for others.
    power : (slots * QUARTERS,) float32 array
        Of each quarter.
    scratch : Scratch
        Set.

    Returns
    -------
    count : int
        As many as `scratch` has room for if they do not fit.
    """
    rays, seen, bins, parts = scratch
    listed = find_cells(look, tiles, among, seen)
    if listed == len(seen.slot):
        return listed
    cast_shadows(look, tiles.resolution_m, seen, listed, depth, rays)
    count = place_cells(look, tiles.resolution_m, bins.every, rays, seen, listed)
    expect(look, seen, count, power, parts, bins)
    return count


@compiled_within
def learn(look: Look, count: int, powers: Powers, least_news: float, scratch: Scratch) -> None:
    """Move the powers of the cells that a look sees towards what explains it."""
    weigh_bins(look, scratch.bins)
    learn_powers(look, scratch.seen, count, scratch.bins, powers, least_news)


@compiled_within
def deal(
    look: Look,
    tiles: Tiles,
    count: int,
    believed: Believed,
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
    believed : Believed
        What is known of the map.
    rules : Rules
        How much counts.
    scratch : Scratch
        After `look_at`.
    said : Said
        Added to.
    """
    rays, seen, bins, parts = scratch
    prepare_bins(look, bins)
    add_evidence(look, seen, count, bins, parts, tiles, rules.bounds, said.evidence)
    add_shares(look, seen, count, bins, parts, said.shares)
    prove_rays(look, seen, count, bins, parts, believed.log_odds, tiles, rays.proven_m)
    deal_proof(look, tiles, rays, said.evidence.clear)
    deal_presence(look, tiles, rules.proof, rules.bounds, said.evidence)
    deal_silence(
        look, tiles, rays, believed.passed, rules.proof, rules.trust_m, rules.median_power,
        said.evidence.silent,
    )  # fmt: skip


class Model(NamedTuple):
    """The map as a visit finds it.

    Parameters
    ----------
    tiles : Tiles
        The grid.
    believed : Believed
        What is known of its cells.
    powers : Powers
        What they scatter.
    rules : Rules
        How much of a visit counts.
    """

    tiles: Tiles
    believed: Believed
    powers: Powers
    rules: Rules


class Errand(NamedTuple):
    """What visits are for.

    Parameters
    ----------
    first : int
        Row of the first look.
    pings : int
        How many looks there are; after the last row comes the first.
    first_dealt : int
        The first whose evidence is dealt, counted from `first`.
    is_taught : bool
        Whether powers are learnt from them.
    least_news : float
        What a look counts at least in the averages that powers are learnt from.
    """

    first: int
    pings: int
    first_dealt: int
    is_taught: bool
    least_news: float


def after(errand: Errand, visits: int) -> Errand:
    """What remains of an errand."""
    return errand._replace(
        first=errand.first + visits,
        pings=errand.pings - visits,
        first_dealt=max(errand.first_dealt - visits, 0),
    )


@compiled
def visit(
    looks: Looks,
    errand: Errand,
    expected: int,
    model: Model,
    scratch: Scratch,
    said: Said,
) -> int:
    """Visit looks in turn: expect what they hear, deal what they say, learn from them.

    Parameters
    ----------
    looks : Looks
        The window.
    errand : Errand
        Which of them, and what for.
    expected : int
        If not negative, `look_at` has been called for the first look, and it sees so many cells.
    model : Model
        The map; its powers are learnt, if that is asked for.
    scratch : Scratch
        Room; nothing is left in `seen`.
    said : Said
        Added to.

    Returns
    -------
    visited : int
        How many; the next one sees more cells than `scratch` has room for if it is not all.
    """
    tiles, believed, powers, rules = model
    for index in range(errand.pings):
        look = look_in(looks, (errand.first + index) % len(looks.bins))
        count = expected
        if index or count < 0:
            count = look_at(look, tiles, believed.depth, powers.alive, powers.power, scratch)
        if count == len(scratch.seen.slot):
            return index
        if index >= errand.first_dealt:
            deal(look, tiles, count, believed, rules, scratch, said)
        if errand.is_taught:
            learn(look, count, powers, errand.least_news, scratch)
        forget(scratch.seen, count)
    return errand.pings


@compiled_within
def forget(seen: Seen, count: int) -> None:
    """Let no cell be seen any more."""
    for cell in range(count):
        seen.place[seen.slot[cell]] = -1
