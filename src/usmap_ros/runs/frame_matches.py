"""How frames of robots relate, as far as the maps tell that are made in them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from usmap_ros.errors import MapSizeError
from usmap_ros.grids import OccupancyMap
from usmap_ros.localisation.linked_frames import Link, links
from usmap_ros.localisation.map_match import Match, match_maps
from usmap_ros.localisation.planar import between, compose
from usmap_ros.localisation.pose_kind import PoseKind, is_own_frame, robot_of
from usmap_ros.localisation.refine import refine_poses
from usmap_ros.mapping.far_off import Ping
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.moved_pings import PingsOfFrame
from usmap_ros.runs.promising import EarlierMatch, Pair, first_look, joined_by
from usmap_ros.runs.submaps import Way, brought_in_line, map_of, pieces_of_ways, way_of
from usmap_ros.runs.told_ways import WayInMap, way_in_map

#: Of fewer pings nobody asks what they show.
_LEAST_PINGS = 20
#: Maps that are made of poses refined together lie where the match has them, up to so much, m, rad.
_STAYS_M, _STAYS_RAD = 0.4, 0.15


@dataclass
class JoinedRobots:
    """Robots whose frames are one."""

    #: Which pings are theirs.
    rows: list[int]
    #: Who they are.
    robots: set[str]
    #: What was known there before.
    earlier: OccupancyMap | None = None
    #: What they make of it, and piece by piece of their ways; None: it is not worked out.
    map: OccupancyMap | None = None
    ways: list[Way] | None = None
    #: What its way shows by odometry as told, if it is one robot's.
    told_way: Way | None = None


class SecondLook(NamedTuple):
    """What was found with poses refined together, as if two frames lay as a match has them."""

    #: With that change, and with what counts for it then.
    match: Match
    #: List of (topic, EchoCone): those poses in the first frame, of its pings and then of those of
    #: the second one.
    pings: list[Ping]


@dataclass
class FrameMatches:
    """Matches of each two frames, worked out once."""

    #: By their names.
    frames: Mapping[str, JoinedRobots]
    #: Pings in these frames, with poses as they were told, and as each frame's were refined.
    told: Sequence[Ping]
    refined: Sequence[Ping]
    #: What the poses of each robot are.
    kinds: Mapping[str, PoseKind]
    #: Of the maps.
    parameters: PipelineParameters
    _found: dict[Pair, Match | None] = field(default_factory=dict)
    #: By margins, the largest first; and the first of them that a second look makes sure of.
    _promising: dict[Pair, list[Match]] = field(default_factory=dict)
    _sure: dict[Pair, SecondLook | None] = field(default_factory=dict)
    #: Ways in the other's map that are promising, by odometry as told.
    _by_ways: dict[Pair, WayInMap | None] = field(default_factory=dict)
    #: Of frames that have been joined since.
    _earlier: list[EarlierMatch] = field(default_factory=list)

    def links(self, looks_again: bool) -> list[Link]:
        """How frames lie in others for sure, if wanted after a second look."""
        # Of frames that several robots share, nobody asks how they relate.
        enough = [
            name
            for name, frame in self.frames.items()
            if frame.earlier is not None or len(frame.rows) >= _LEAST_PINGS
        ]
        ranked = sorted(
            enough,
            key=lambda name: (
                self.frames[name].earlier is None,
                is_own_frame(name),
                -len(self.frames[name].rows),
            ),
        )
        pairs = [pair for pair in combinations(ranked, 2) if is_own_frame(pair[1])]
        matches = {pair: match for pair in pairs if (match := self._match(pair))}
        sure = {pair: match for pair, match in matches.items() if match.is_sure}
        made = links(sure, ranked, is_own_frame)
        if not made and looks_again:
            # What is joined tells more of the rest, at less cost than a second look does.
            sure = self._borne_out(matches) or self._borne_out_by_ways(pairs)
            made = links(sure, ranked, is_own_frame)
        self._keep(matches, made)
        return made

    def forget(self, changed: Iterable[str]) -> None:
        """Work matches of some frames out anew."""
        names = set(changed)
        for found in (self._found, self._promising, self._sure, self._by_ways):
            for pair in [pair for pair in found if names & set(pair)]:
                del found[pair]

    def _keep(self, matches: Mapping[Pair, Match], made: Sequence[Link]) -> None:
        """Keep matches of frames that links join with others than each other."""
        changed = {name for link in made for name in (link.target, link.source)}
        for pair, match in matches.items():
            if changed & set(pair):
                ones, others = (self.frames[name].ways or [] for name in pair)
                self._earlier.append(EarlierMatch(pair, match, ones, others))
        self._earlier = joined_by(self._earlier, made)

    def refined_by(self, made: Sequence[Link]) -> list[Ping] | None:
        """Pings by the second look that made sure of a link, its target's first; or None."""
        looks = [self._sure.get((link.target, link.source)) for link in made]
        return looks[0].pings if len(looks) == 1 and looks[0] else None

    def _match(self, pair: Pair) -> Match | None:
        if pair not in self._found:
            self._found[pair] = None
            # A robot that has lost itself makes a map that is too large, and joins nobody.
            with suppress(MapSizeError):
                maps = (self._map_of(self.frames[name]) for name in pair)
                self._found[pair] = match_maps(*maps)
        return self._found[pair]

    def _borne_out(self, matches: Mapping[Pair, Match]) -> dict[Pair, Match]:
        """The first of those that are promising of which a second look makes sure."""
        asked = {
            pair: promising
            for pair, match in matches.items()
            if self.frames[pair[0]].earlier is None and (promising := self._ask(pair, match))
        }
        for pair, promising in sorted(asked.items(), key=lambda each: -each[1][0].margin):
            if pair not in self._sure:
                self._sure[pair] = self._look_again(pair, promising)
            if again := self._sure[pair]:
                return {pair: again.match}
        return {}

    def _ask(self, pair: Pair, match: Match) -> list[Match]:
        if pair not in self._promising:
            now = first_look(match, *(self._ways_of(self.frames[name]) for name in pair))
            found = [now, *(one.promising(pair) for one in self._earlier)]
            by_margin = sorted(filter(None, found), key=lambda one: -one.margin)
            self._promising[pair] = by_margin
        return self._promising[pair]

    def _borne_out_by_ways(self, pairs: Iterable[Pair]) -> dict[Pair, Match]:
        """The first way in another's map, by odometry as told, that a second look makes sure of."""
        asked = {pair: found for pair in pairs if (found := self._ask_ways(pair))}
        for pair, found in sorted(asked.items(), key=lambda each: -each[1].margin):
            link = Link(*pair, found.change, found.about_m)
            again = second_look(found.target, found.source, link, self.kinds, self.parameters)
            if again and again.match.bears_out(None):
                self._sure[pair] = again
                return {pair: again.match}
            self._by_ways[pair] = None
        return {}

    def _ask_ways(self, pair: Pair) -> WayInMap | None:
        if pair not in self._by_ways:
            self._by_ways[pair] = None
            frames = [self.frames[name] for name in pair]
            if frames[0].earlier is None:
                with suppress(MapSizeError):
                    maps = [self._map_of(frame) for frame in frames]
                    told_ways = [self._told_way_of(name) for name in pair]
                    pings = [self._pings_of(frame) for frame in frames]
                    self._by_ways[pair] = way_in_map(pings, maps, told_ways)
        return self._by_ways[pair]

    def _told_way_of(self, name: str) -> Way:
        """Of a robot that is alone in its frame; nothing of others, nor of what is one piece."""
        frame = self.frames[name]
        if frame.told_way is None:
            frame.told_way = []
            if is_own_frame(name) and [len(way) > 1 for way in self._ways_of(frame)] == [True]:
                told = [self.told[row] for row in frame.rows]
                frame.told_way = way_of(told, range(len(told)), self.parameters)
        return frame.told_way

    def _pings_of(self, frame: JoinedRobots) -> PingsOfFrame:
        return PingsOfFrame(
            [self.told[row] for row in frame.rows],
            [self.refined[row] for row in frame.rows],
            self._ways_of(frame),
        )

    def _look_again(self, pair: Pair, promising: Sequence[Match]) -> SecondLook | None:
        one, other = (self._pings_of(self.frames[name]) for name in pair)
        looked_at: list[Match] = []
        for match in promising:
            if any(_stays(match.change, before) for before in looked_at):
                continue
            looked_at.append(match)
            link = Link(*pair, match.change, match.about_m)
            again = second_look(one, other, link, self.kinds, self.parameters)
            if again and again.match.bears_out(match):
                return again
        return None

    def _ways_of(self, frame: JoinedRobots) -> list[Way]:
        if frame.ways is None:
            frame.ways = pieces_of_ways([self.refined[row] for row in frame.rows], self.parameters)
        return frame.ways

    def _map_of(self, frame: JoinedRobots) -> OccupancyMap:
        if frame.map is None:
            pings = [self.refined[row] for row in frame.rows]
            frame.map = map_of(pings, self.parameters, frame.earlier)
        return frame.map


def second_look(
    target: PingsOfFrame,
    source: PingsOfFrame,
    link: Link,
    kinds: Mapping[str, PoseKind],
    parameters: PipelineParameters,
) -> SecondLook | None:
    """A match by maps that are made of poses refined together, as if a link were right.

    Poses that are off bend maps, which then contradict each other though they are of one place.  If
    they are, both are mended by what they have in common; if not, each is bent to what it is not,
    and less is in common than before.

    Parameters
    ----------
    target, source : PingsOfFrame
        Of the two frames.
    link : Link
        How the frames lie.
    kinds : mapping of str to PoseKind
        What the poses of each robot are.
    parameters : PipelineParameters
        Of the maps.

    Returns
    -------
    SecondLook or None
        None if maps do not lie where the link has them any more.
    """
    there, count = source.moved_by(link), len(target.told)
    told, before = target.told + there.told, target.refined + there.refined
    if all(kinds[robot_of(*ping)].drifts for ping in told):
        behind = [[each._replace(rows=each.rows + count) for each in way] for way in source.ways]
        ways = [(way, np.zeros(3)) for way in target.ways] + [(way, link.change) for way in behind]
        before = brought_in_line(told, before, ways)
    together = refine_poses(told, kinds=kinds, before=before).pings
    match: Match | None = None
    with suppress(MapSizeError):
        maps = together[:count], together[count:]
        match = match_maps(*(map_of(each, parameters) for each in maps))
    if match is None or not _stays(np.zeros(3), match):
        return None
    return SecondLook(replace(match, change=link.change, about_m=link.about_m), together)


def _stays(change: FloatArray, match: Match) -> bool:
    """Whether a match puts maps where a change does."""
    about = np.append(match.about_m, 0.0)
    off = between(compose(change, about), compose(match.change, about))
    return math.hypot(*off[:2]) <= _STAYS_M and abs(off[2]) <= _STAYS_RAD
