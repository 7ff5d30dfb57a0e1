"""Ping update: what the map expects of a ping, and what the ping says of the map.

Each is one call, because from Python it takes as long to hand over the arrays as to work on them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.superposition.cells import Tiles
from usmap_ros.mapping.superposition.forward_model import Bins, Contributions, expect
from usmap_ros.mapping.superposition.free_space import (
    clear_under_robot,
    prove_free,
    trust_silence,
)
from usmap_ros.mapping.superposition.inverse_sensor_model import (
    Bounds,
    Evidence,
    add_evidence,
    prepare_bins,
    prove_rays,
)
from usmap_ros.mapping.superposition.ping_bins import Look
from usmap_ros.mapping.superposition.power_estimation import Powers, learn_powers, weigh_bins
from usmap_ros.mapping.superposition.ray_casting import cast_shadows
from usmap_ros.mapping.superposition.responsibilities import Responsibilities, add_responsibilities
from usmap_ros.mapping.superposition.visible_cells import (
    Rays,
    VisibleCells,
    find_cells,
    place_cells,
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
    seen : VisibleCells
        Cells that it sees.
    bins : Bins
        Its range bins.
    parts : Contributions
        What is expected of the cells in them.
    """

    rays: Rays
    seen: VisibleCells
    bins: Bins
    parts: Contributions


class Accumulators(NamedTuple):
    """What pings say of cells.

    Parameters
    ----------
    evidence : Evidence
        For and against them.
    responsibilities : Responsibilities
        Theirs in what was heard.
    """

    evidence: Evidence
    responsibilities: Responsibilities


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


class CellState(NamedTuple):
    """What is known of the cells of the map; (slots,) float32 arrays.

    Parameters
    ----------
    depth : float32 array
        Optical depth of each cell for sound that crosses it.
    log_odds : float32 array
        That a cell holds something.
    clear : float32 array
        Rays known to have passed it.
    """

    depth: NDArray[np.float32]
    log_odds: NDArray[np.float32]
    clear: NDArray[np.float32]


@compiled
def expect_ping(
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
        The ping in bins of range.
    tiles : Tiles
        Where the grid's cells are in memory.
    depth : (slots,) float32 array
        Optical depth of each cell.
    among : (slots,) float32 array
        Above 0 for cells that may hold something, 0 for others.
    power : (slots * QUARTERS,) float32 array
        Of each quarter.
    scratch : Scratch
        Room for rays, cells and bins, which are set.

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
def gather_evidence(
    look: Look,
    tiles: Tiles,
    count: int,
    state: CellState,
    rules: Rules,
    scratch: Scratch,
    sums: Accumulators,
) -> None:
    """Add what a look says of cells, and of the way to them.

    Parameters
    ----------
    look : Look
        The ping in bins of range.
    tiles : Tiles
        Where the grid's cells are in memory.
    count : int
        Number of cells that it sees.
    state : CellState
        What is known of the map.
    rules : Rules
        How much counts.
    scratch : Scratch
        Rays, cells and bins as `expect_ping` left them.
    sums : Accumulators
        Sums over pings, to which this one's evidence is added.
    """
    rays, seen, bins, parts = scratch
    prepare_bins(look, bins)
    add_evidence(look, seen, count, bins, parts, tiles, rules.bounds, sums.evidence)
    add_responsibilities(look, seen, count, bins, parts, sums.responsibilities)
    prove_rays(look, seen, count, bins, parts, state.log_odds, tiles, rays.proven_m)
    prove_free(look, tiles, rays, sums.evidence.clear)
    clear_under_robot(look, tiles, rules.proof, rules.bounds, sums.evidence)
    trust_silence(
        look, tiles, rays, state.clear, rules.proof, rules.trust_m, rules.median_power,
        sums.evidence.silent,
    )  # fmt: skip


class Model(NamedTuple):
    """The map as a visit finds it.

    Parameters
    ----------
    tiles : Tiles
        Where the grid's cells are in memory.
    state : CellState
        What is known of its cells.
    powers : Powers
        What they scatter.
    rules : Rules
        How much of a visit counts.
    """

    tiles: Tiles
    state: CellState
    powers: Powers
    rules: Rules


class Batch(NamedTuple):
    """What visits are for.

    Parameters
    ----------
    first : int
        Row of the first look.
    pings : int
        How many looks there are; after the last row comes the first.
    first_gathered : int
        The first whose evidence is gathered, counted from `first`.
    is_taught : bool
        Whether powers are learnt from them.
    least_news : float
        What a look counts at least in the averages that powers are learnt from.
    """

    first: int
    pings: int
    first_gathered: int
    is_taught: bool
    least_news: float


def after(batch: Batch, visits: int) -> Batch:
    """What remains of an errand."""
    return batch._replace(
        first=batch.first + visits,
        pings=batch.pings - visits,
        first_gathered=max(batch.first_gathered - visits, 0),
    )


@compiled
def visit(
    looks: Looks,
    batch: Batch,
    expected: int,
    model: Model,
    scratch: Scratch,
    sums: Accumulators,
) -> int:
    """Visit looks in turn: expect what they hear, gather what they say, learn from them.

    Parameters
    ----------
    looks : Looks
        All pings of the window, one a row.
    batch : Batch
        Which of them, and what for.
    expected : int
        If not negative, `expect_ping` was called for the first look, and it sees so many cells.
    model : Model
        The map; its powers are learnt, if that is asked for.
    scratch : Scratch
        Room; nothing is left in `seen`.
    sums : Accumulators
        Sums over pings, to which this one's evidence is added.

    Returns
    -------
    visited : int
        How many; the next one sees more cells than `scratch` has room for if it is not all.
    """
    tiles, state, powers, rules = model
    for index in range(batch.pings):
        look = look_in(looks, (batch.first + index) % len(looks.bins))
        count = expected
        if index or count < 0:
            count = expect_ping(look, tiles, state.depth, powers.alive, powers.power, scratch)
        if count == len(scratch.seen.slot):
            return index
        if index >= batch.first_gathered:
            gather_evidence(look, tiles, count, state, rules, scratch, sums)
        if batch.is_taught:
            learn(look, count, powers, batch.least_news, scratch)
        forget(scratch.seen, count)
    return batch.pings


@compiled_within
def forget(seen: VisibleCells, count: int) -> None:
    """Let no cell be seen any more."""
    for cell in range(count):
        seen.place[seen.slot[cell]] = -1
