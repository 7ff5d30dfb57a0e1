"""Which way two maps lie over each other that are bent, by what their submaps have in common.

Odometry that drifts bends the map of a whole run, and bent maps lie over each other nowhere as a
whole: they contradict each other though they are of one place, and at times a wrong match has less
against it than the right one.  Submaps of some tens of pings are hardly bent.  So each one of a
robot is laid over each one of the other near where a match has them, and what they have in common
counts together with what the whole maps have (submaps: Bosse et al., IJRR 2004).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from usmap_ros.localisation.map_match import Match, margin_elsewhere
from usmap_ros.localisation.submap import Submap, counts, refined
from usmap_ros.numerics.arrays import FloatArray

#: How far two submaps may lie from where a match of whole maps has them: x, y (m) and yaw (rad),
#: standard deviations.  By twice as much, mirror images lie over each other as well as what is
#: right.
_HELD = np.array([0.08, 0.08, math.radians(3.0)])
#: Matches of whole maps that are asked about.
_ASKED = 10
#: A match is promising by submaps if its margin is so large, less so many times the share that
#: stands in the other's free space.  Few of those reach it that lay a flat over its mirror image.
_LEAST_SURENESS, _DOUBT = 3.0, 30.0
#: Pieces of whole maps and submaps together, at the least.
_LEAST_PIECES = 24.0


def promising_by_submaps(
    match: Match, ones: Sequence[Submap], others: Sequence[Submap]
) -> Match | None:
    """The match that submaps have most to say for, if there is enough and none nearly as good.

    Parameters
    ----------
    match : Match
        Of the two maps, with all that were tried.
    ones, others : sequences of Submap
        Of either map, in its frame.

    Returns
    -------
    Match or None
        With margins as of whole maps: what is right often has little, or none, before poses are
        refined together.
    """
    places_m = np.concatenate([np.zeros((0, 2)), *(each.places_m for each in others)])
    found: list[tuple[FloatArray, float]] = []
    shares: list[float] = []
    for change, pieces in match.tried[:_ASKED]:
        net, share = _in_common(ones, others, change)
        found.append((change, pieces + net))
        shares.append(share)
    if not found or not len(places_m):
        return None
    best = max(range(len(found)), key=lambda number: found[number][1])
    change, pieces = found[best]
    if pieces < _LEAST_PIECES:
        return None
    if margin_elsewhere(places_m, change, pieces, found) - _DOUBT * shares[best] < _LEAST_SURENESS:
        return None
    return replace(match, change=change, pieces=match.tried[best][1]).with_margins(places_m)


def _in_common(
    ones: Sequence[Submap], others: Sequence[Submap], change: FloatArray
) -> tuple[float, float]:
    """Pieces of all pairs of submaps, net; the share that is in the other's free space."""
    net = in_both = in_free = 0.0
    for one in ones:
        for other in others:
            if not (len(one.places_m) and len(other.places_m)):
                continue
            if not any(counts(one, other, change)):
                continue
            pieces, there = refined(one, other, change, _HELD)
            both, against = counts(one, other, there)
            net, in_both, in_free = net + pieces, in_both + both, in_free + against
    return net, in_free / max(in_both, 1.0)
