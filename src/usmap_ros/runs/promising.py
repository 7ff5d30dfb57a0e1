"""Matches that a second look may make sure of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from usmap_ros.localisation.linked_frames import Link
from usmap_ros.localisation.map_match import Match
from usmap_ros.localisation.planar import between, compose
from usmap_ros.localisation.submap_match import promising_by_submaps
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.runs.submaps import Way

#: Names of two frames, of which the second one may be brought into the first one.
Pair = tuple[str, str]

_ORIGIN = np.zeros(3)


def first_look(match: Match, ones: Sequence[Way], others: Sequence[Way]) -> Match | None:
    """The match of two frames that a second look is worth while for, if there is one.

    Parameters
    ----------
    match : Match
        Of the maps of both frames.
    ones, others : sequences of list of Piece
        Of ways in either frame.
    """
    if match.is_sure:
        # It has been contradicted by others.
        return None
    submaps = ([piece.submap for way in ways for piece in way] for ways in (ones, others))
    return promising_by_submaps(match, *submaps) or (match if match.is_promising else None)


class EarlierMatch(NamedTuple):
    """A match of two frames from before one of them was joined with others.

    Poses that are refined together may be bent more than each robot's were, and then the map of all
    of them no longer shows how the third lies that either map alone has shown.
    """

    #: The frames that they are part of now.
    pair: Pair
    #: As it was.
    match: Match
    #: Of ways in either frame, as far as they had been mapped piece by piece.
    ones: Sequence[Way]
    others: Sequence[Way]
    #: (3,) arrays: poses of the two frames in those that they are part of now, x, y (m), yaw (rad).
    one: FloatArray = _ORIGIN
    other: FloatArray = _ORIGIN

    def joined_by(self, link: Link) -> EarlierMatch:
        """The same once a link is made."""
        poses = (
            compose(link.change, pose) if frame == link.source else pose
            for frame, pose in zip(self.pair, (self.one, self.other), strict=True)
        )
        first, second = (link.target if name == link.source else name for name in self.pair)
        return EarlierMatch((first, second), self.match, self.ones, self.others, *poses)

    def promising(self, pair: Pair) -> Match | None:
        """As a match of the frames of now, in that order; None if it is not promising."""
        found = first_look(self.match, self.ones, self.others)
        if found is None or set(pair) != set(self.pair):
            return None
        change = compose(compose(self.one, found.change), between(self.other, _ORIGIN))
        about = compose(self.other, np.append(found.about_m, 0.0))
        if pair != self.pair:
            change, about = between(change, _ORIGIN), compose(change, about)
        return replace(found, change=change, about_m=about[:2], tried=())


def joined_by(earlier: Sequence[EarlierMatch], links: Sequence[Link]) -> list[EarlierMatch]:
    """Those of some that are of two frames still, after links are made one after the other."""
    left = list(earlier)
    for link in links:
        left = [match.joined_by(link) for match in left]
    return [match for match in left if match.pair[0] != match.pair[1]]
