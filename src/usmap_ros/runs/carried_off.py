"""Robots that were carried off while they were on, of which their wheels know nothing.

What a robot hears is mapped in blocks, the pieces of its way.  Where all that come after some ping
have things where those before it know of free space, and little in common with them, the robot is
somewhere else: it begins anew, as another robot in a frame of its own, until its map is joined.
Blocks that contradict those next to them as well say that poses drift, not where the robot is: such
a robot goes on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from itertools import combinations, count, pairwise
from typing import NamedTuple

import numpy as np

from usmap_ros.errors import MapSizeError
from usmap_ros.localisation.pose_kind import PoseKind, robot_of
from usmap_ros.localisation.submap import Submap, in_common
from usmap_ros.mapping.far_off import Ping
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.runs.restarts import MARK, first_name, of_life
from usmap_ros.runs.submaps import OF_PIECE, Way, way_of

#: Blocks that a robot must have been elsewhere for, and in one place before: a single one, whose
#: poses may be bent, agrees with itself whatever it is.
_FOR_LONG = 2
#: Pieces of earlier and later blocks that stand in each other's free space: so many, and such a
#: share of those that stand in both.  On robots that were not carried off it was 0.1 at the most.
_AGAINST, _SHARE = 10.0, 0.5
#: The largest such share among blocks between which it was not carried off: they agree, up to 0.01
#: where it was carried off once, and 0.1 to 0.4 where a robot drifts more than could be made good.
_AT_ODDS = 0.05
#: Directions of an echo that are asked for what is there; from which worth on it is explained, and
#: up to which contradicted.
_BEARINGS, _EXPLAINED, _CONTRADICTED = 15, 0.3, -1.0


class Lives(NamedTuple):
    """Pings of robots, of which some were carried off."""

    #: List of (topic, EchoCone): as told, in the order they came in; from when a robot was carried
    #: off on under another name.
    told: list[Ping]
    #: Names of the robots that have begun anew.
    lost: set[str]
    #: What ways show of robots that were looked at, and were not carried off.
    ways: dict[str, Way]


def with_lives(
    told: Sequence[Ping],
    refined: Sequence[Ping],
    kinds: Mapping[str, PoseKind],
    parameters: PipelineParameters,
) -> Lives:
    """Give robots that were carried off another name from then on.

    Parameters
    ----------
    told, refined : sequences of (topic, EchoCone)
        The same pings with poses as they were told, and as they were refined.
    kinds : mapping of str to PoseKind
        What the poses of each robot are; those that are absolute cannot be lost.
    parameters : PipelineParameters
        Of the maps.
    """
    rows: dict[str, list[int]] = {}
    for row, (topic, cone) in enumerate(told):
        rows.setdefault(robot_of(topic, cone), []).append(row)
    lives, names = Lives(list(told), set(), {}), set(rows)
    for robot, own in rows.items():
        if not kinds[robot].drifts or len(own) < 2 * OF_PIECE:
            continue
        own.sort(key=lambda row: told[row][1].stamp_ns)
        begins: list[int] = []
        # A robot whose map is too large has lost itself altogether.
        with suppress(MapSizeError):
            way = way_of(refined, own, parameters)
            begins = moments([refined[row] for row in own], way)
            if not begins:
                lives.ways[robot] = way
        for begin in begins:
            own_name = first_name(robot).strip("/")
            life = next(n for n in count(2) if f"{own_name}{MARK}{n}" not in names)
            name, frame_id = f"{own_name}{MARK}{life}", f"{own_name}/odom{MARK}{life}"
            names.add(name)
            lives.lost.add(name)
            for row in own[begin:]:
                lives.told[row] = of_life(told[row], name, frame_id)
    return lives


def moments(pings: Sequence[Ping], way: Way) -> list[int]:
    """Before which of a robot's pings it was carried off.

    Parameters
    ----------
    pings : sequence of (topic, EchoCone)
        Of one robot, in the order of their stamps, in one frame.
    way : list of Piece
        What they show, piece by piece.
    """
    blocks = [piece.submap for piece in way]
    starts = np.cumsum([0, *(len(piece.rows) for piece in way)])
    counts = np.zeros((len(blocks), len(blocks), 2))
    for one, other in combinations(range(len(blocks)), 2):
        counts[one, other] = in_common(blocks[one], blocks[other])
    numbers, found = _splits(counts, 0, len(blocks)), []
    if not _agree_between(counts, numbers):
        return []
    for number in numbers:
        # Either of the blocks on both sides may have seen the moment.
        begin, end = starts[number - 1], starts[number + 1]
        among = [cone for _, cone in pings[begin:end]]
        found.append(int(begin) + _moment(among, blocks[:number], blocks[number:]))
    return found


def _splits(counts: FloatArray, first: int, end: int) -> list[int]:
    """Blocks of some with which a robot is elsewhere than before, in order."""
    best, most = None, 0.0
    for number in range(first + _FOR_LONG, end - _FOR_LONG + 1):
        both, against = counts[first:number, number:end].sum(axis=(0, 1))
        gain = float(against - _SHARE * both)
        if against >= _AGAINST and gain > most:
            best, most = number, gain
    if best is None:
        return []
    return [*_splits(counts, first, best), best, *_splits(counts, best, end)]


def _agree_between(counts: FloatArray, numbers: Sequence[int]) -> bool:
    """Whether blocks agree with those of the same place, from each moment to the next."""
    ends = [0, *numbers, len(counts)]
    both, against = sum(
        (counts[first:end, first:end].sum(axis=(0, 1)) for first, end in pairwise(ends)),
        start=np.zeros(2),
    )
    return bool(against <= _AT_ODDS * both)


def _moment(cones: Sequence[EchoCone], before: Sequence[Submap], after: Sequence[Submap]) -> int:
    """The ping from which on what stands later explains more than what stood before."""
    gains = [_explained(cone, after) - _explained(cone, before) for cone in cones]
    # From each ping on to the end.
    return int(np.argmax(np.cumsum(gains[::-1])[::-1]))


def _explained(cone: EchoCone, submaps: Sequence[Submap]) -> float:
    """1 if something stands where the first echo may come from, -1 if all of that is free."""
    if not len(cone.ranges_m):
        return 0.0
    half_angle_rad = cone.transducer.beam.half_angle_rad
    angles = cone.pose.yaw_rad + np.linspace(-half_angle_rad, half_angle_rad, _BEARINGS)
    arc: FloatArray = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * cone.ranges_m.min()
    places_m = cone.pose.position_m[:2] + arc
    sides = np.zeros_like(places_m)
    best = max(submap.worth_at(places_m, sides).max() for submap in submaps)
    return float(best > _EXPLAINED) - float(best < _CONTRADICTED)
