"""Frames that sure matches link, brought into one at once."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.localisation.map_match import Match
from usmap_ros.localisation.planar import between, compose
from usmap_ros.numerics.arrays import FloatArray

#: Matches contradict each other if by one of them a map lies so far from where it does by others,
#: m and rad: less is how far maps of poses that are off are bent.
_APART_M, _APART_RAD = 1.0, math.radians(20.0)


@dataclass(frozen=True)
class Link:
    """How one frame lies in another one."""

    #: The frame that stays, and the one that is brought into it.
    target: str
    source: str
    #: (3,) array: x, y (m) and yaw (rad) of the source in the target.
    change: FloatArray
    #: (2,) array: in the source: what the match is off, it is off there.
    about_m: FloatArray


def links(
    sure: Mapping[tuple[str, str], Match], ranked: Sequence[str], may_move: Callable[[str], bool]
) -> list[Link]:
    """Links to make one after the other, those of the surest matches first.

    Where matches contradict each other nobody knows which is wrong: none of what they link is
    linked.

    Parameters
    ----------
    sure : mapping of (str, str) to Match
        How the second frame lies in the first one.
    ranked : sequence of str
        All frames; of two that are linked the first stays.
    may_move : callable
        Whether a frame may be brought into another one.
    """
    placed = {name: (name, np.zeros(3)) for name in ranked}
    made: list[Link] = []
    contradicted: set[str] = set()
    for (one, other), match in sorted(sure.items(), key=lambda pair: -pair[1].sureness):
        (target, first), (source, second) = placed[one], placed[other]
        change = compose(compose(first, match.change), between(second, np.zeros(3)))
        about = compose(second, np.append(match.about_m, 0.0))
        if target == source:
            off = between(about, compose(change, about))
            if math.hypot(*off[:2]) > _APART_M or abs(off[2]) > _APART_RAD:
                contradicted.add(one)
            continue
        if ranked.index(source) < ranked.index(target):
            target, source = source, target
            about, change = compose(change, about), between(change, np.zeros(3))
        if may_move(source):
            made.append(Link(target, source, change, about[:2]))
            placed |= {
                name: (target, compose(change, pose))
                for name, (frame, pose) in placed.items()
                if frame == source
            }
    unknown = {placed[name][0] for name in contradicted}
    return [link for link in made if placed[link.source][0] not in unknown]
