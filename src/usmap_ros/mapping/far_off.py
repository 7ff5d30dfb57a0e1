"""Pings from so far away from all others that they are not of the same map.

One wrong pose, of a robot that has lost itself or counts from another origin, must neither lock
out all who come later nor end a run.
"""

from __future__ import annotations

import copy
import itertools
import math
from collections import Counter
from dataclasses import dataclass, field

from usmap_ros.errors import MalformedMessageError, MapSizeError
from usmap_ros.grids import GridGeometry
from usmap_ros.mapping.common_frame import ENOUGH_PINGS, ENOUGH_S, Opening, shares
from usmap_ros.mapping.extent import Extent
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Side of the squares that pings are counted in: those that touch are one place.
SQUARE_M = 50.0
#: Places that are remembered, and pings of each that wait until it is known to be one.
_MOST_PLACES, _MOST_HELD = 64, 200
#: Squares of the map's rectangle for each in which somebody pinged, from which on another place is
#: too far off.
_MOST_SPARSE = 8
#: Pings of a robot that is elsewhere all the time, from which on that is no mistake.
_FEW_PINGS = 5

#: Topic and cone.
Ping = tuple[str, EchoCone]
_Square = tuple[int, int]


class FarOffError(MalformedMessageError):
    """A ping that stays out of the map because of where it was sent."""


@dataclass
class _Place:
    """Squares that touch one another, who pinged there, and the pings that wait."""

    squares: set[_Square]
    is_mapped: bool = False
    #: Whether a map with it would be too large.
    is_refused: bool = False
    held: list[Ping] = field(default_factory=list)
    topics: Counter[str] = field(default_factory=Counter)
    first_ns: int | None = None
    has_lasted: bool = False

    def add(self, topic: str, stamp_ns: int) -> None:
        self.topics[topic] += 1
        self.first_ns = stamp_ns if self.first_ns is None else self.first_ns
        self.has_lasted |= stamp_ns - self.first_ns >= ENOUGH_S * 1e9

    def join(self, other: _Place) -> None:
        self.squares |= other.squares
        self.held += other.held
        self.topics += other.topics
        self.has_lasted |= other.has_lasted

    def take_held(self) -> list[Ping]:
        held, self.held = self.held, []
        return held


class FarOff:
    """Sets pings apart that are far from where most robots are.

    During the first seconds, the place of the first ping stands in for the map's; then it is the
    place with most robots, each of which counts by the share of its pings.  Somebody who goes on
    pinging elsewhere is taken up after some seconds, if the map's rectangle has room for both.

    Parameters
    ----------
    parameters : MappingParameters
        Say how large a map may become.
    """

    def __init__(self, parameters: MappingParameters) -> None:
        self._parameters = parameters
        self._extent = Extent(parameters)
        self._places: list[_Place] = []
        self._pings: Counter[str] = Counter()
        self._opening = Opening()
        self.is_decided = False

    def cover(self, geometry: GridGeometry) -> None:
        """Begin with a map that there is already: its place is the map's.

        Raises
        ------
        MapSizeError
            If it is larger than a map may be.
        """
        self._extent.cover(geometry)
        west, east, south, north = (math.floor(side / SQUARE_M) for side in geometry.extent_m)
        squares = itertools.product(range(west, east + 1), range(south, north + 1))
        self._places.append(_Place(set(squares), is_mapped=True))
        self.is_decided = True

    def add(self, topic: str, cone: EchoCone) -> list[Ping]:
        """Take a ping.

        Returns
        -------
        pings : list of (str, EchoCone)
            What is to be mapped now: others of its place that were held, and itself.

        Raises
        ------
        FarOffError
            If it is not to be mapped, or not now.
        """
        place = self._place_of(cone)
        place.add(topic, cone.stamp_ns)
        self._pings[topic] += 1
        if not self.is_decided:
            self._opening.add(topic, cone.stamp_ns)
        place.is_mapped |= len(self._places) == 1
        if place.is_mapped:
            self._stretch([(topic, cone)])
            return [*self._fitting(place.take_held()), (topic, cone)]
        if not place.is_refused:
            place.held.append((topic, cone))
            if self.is_decided and place.has_lasted and place.topics.total() >= ENOUGH_PINGS:
                return self._take_up(place)
            if self.is_decided:
                del place.held[:-_MOST_HELD]
        raise FarOffError(
            "pose.position",
            f"is {self._extent.distance_m(cone):.0f} m away from all pings that are mapped",
        )

    def decide(self, *, is_over: bool = False) -> list[Ping] | None:
        """Decide on the map's place if enough was heard, or nothing more comes.

        Parameters
        ----------
        is_over : bool
            Whether nothing more comes.

        Returns
        -------
        pings : list of (str, EchoCone) or None
            With what the map has to begin anew, if its place is another one than the one that
            stood in; None: it goes on as it is.
        """
        if self.is_decided or not self._places or not (is_over or self._opening.is_over):
            return None
        self.is_decided = True
        chosen = max(self._places, key=lambda one: (self._votes(one), one.topics.total()))
        if chosen.is_mapped:
            return None
        for place in self._places:
            place.is_mapped = False
        self._extent = Extent(self._parameters)
        chosen.is_mapped = True
        return self._fitting(chosen.take_held())

    def finish(self) -> list[Ping]:
        """Those of the pings that wait which are no mistake, since nothing more comes.

        They are of robots that were in another place all the time.
        """
        pings: list[Ping] = []
        for place in self._places:
            at_home = any(
                count >= _FEW_PINGS and 2 * count > self._pings[topic]
                for topic, count in place.topics.items()
            )
            if at_home and place.held:
                try:
                    pings += self._take_up(place)
                except FarOffError:
                    continue
        return pings

    def _votes(self, place: _Place) -> int:
        return sum(shares(place.topics, self._pings).values())

    def _place_of(self, cone: EchoCone) -> _Place:
        """The place of a ping; those that it joins become one."""
        x_m, y_m, _ = cone.pose.position_m.tolist()
        square = math.floor(x_m / SQUARE_M), math.floor(y_m / SQUARE_M)
        for place in self._places:
            if square in place.squares:
                return place
        steps = itertools.product((-1, 0, 1), repeat=2)
        around = {(square[0] + east, square[1] + north) for east, north in steps}
        touching = [place for place in self._places if not around.isdisjoint(place.squares)]
        # What is mapped comes first, and takes the others in.
        touching.sort(key=lambda place: not place.is_mapped)
        if not touching:
            touching = [_Place(set())]
            self._places.append(touching[0])
            self._forget_least()
        one, *others = touching
        one.squares.add(square)
        for other in others:
            one.join(other)
            self._places.remove(other)
        return one

    def _forget_least(self) -> None:
        if len(self._places) > _MOST_PLACES:
            # Not the newest, or a thousand odd poses would keep a robot from being heard.
            rest = [place for place in self._places[:-1] if not place.is_mapped]
            self._places.remove(min(rest, key=lambda place: place.topics.total()))

    def _take_up(self, place: _Place) -> list[Ping]:
        """Map a place, and all that was held of it."""
        held = place.take_held()
        try:
            self._refuse_sparse(place)
            self._stretch(held)
        except FarOffError:
            place.is_refused = True
            raise
        place.is_mapped = True
        return held

    def _refuse_sparse(self, place: _Place) -> None:
        """Refuse a place with which the map would be next to nothing but unknown cells.

        It has to be a rectangle, and every cell of that costs memory and time.
        """
        squares = place.squares.union(*(one.squares for one in self._places if one.is_mapped))
        columns, rows = (max(side) - min(side) + 1 for side in zip(*squares, strict=True))
        if columns * rows > _MOST_SPARSE * len(squares):
            raise FarOffError(
                "pose.position",
                f"is so far away that {columns * rows} squares of {SQUARE_M:g} m would be a map of"
                f" {len(squares)}: map robots that are so far apart by themselves",
            )

    def _stretch(self, pings: list[Ping]) -> None:
        """Make room for pings, or leave the rectangle as it is."""
        stretched = copy.copy(self._extent)
        try:
            for _, cone in pings:
                stretched.add(cone)
        except MapSizeError as error:
            raise FarOffError("pose.position", str(error)) from error
        self._extent = stretched

    def _fitting(self, pings: list[Ping]) -> list[Ping]:
        """Those for which there is room."""
        fitting = []
        for ping in pings:
            try:
                self._stretch([ping])
            except FarOffError:
                continue
            fitting.append(ping)
        return fitting
