"""How sure matches of two robots' maps are, of one place and of different ones.

What `_LEAST_SURENESS` of `src/usmap_ros/localisation/map_match.py` is chosen by: ``python
benchmarks/margins.py --kinds flat_rough --seeds 201 202 203``.  Each robot is refined and mapped by
itself, and each two maps of all scenes are laid over each other.  Scenes of one seed are one place,
and flats are one whatever the seed; all other pairs share nothing, and whatever match is found of
them is wrong.  ``symmetric`` are rooms that are the same after half a turn.  Where a match is
promising, but not sure, or another one is by submaps, it says how far that one is off, m, and what
becomes of its margin over matches elsewhere at a second look, with poses refined together as if it
were right; ``-`` where maps lie elsewhere then.  The column after that says the same of the way of
one, as odometry tells it, in the map of the other; the last one how many pieces maps have in common
where they truly lie, and at the most where others of those that were tried have them, 1 m away or
more, and little is contradicted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from joining import heard, laid_over, options, unknown_starts
from numpy.typing import NDArray
from poses import Ping, places

from usmap_ros.grids import OccupancyMap
from usmap_ros.localisation import Match, match_maps, refine_poses
from usmap_ros.localisation.linked_frames import Link
from usmap_ros.localisation.map_match import ELSEWHERE_M
from usmap_ros.localisation.planar import between, compose
from usmap_ros.localisation.refine import kinds_of
from usmap_ros.localisation.submap import Submap, apart_m, counts, refined
from usmap_ros.parameters import PipelineParameters
from usmap_ros.runs.frame_matches import SecondLook, second_look
from usmap_ros.runs.moved_pings import PingsOfFrame
from usmap_ros.runs.promising import first_look
from usmap_ros.runs.submaps import Way, map_of, pieces_of_ways, way_of
from usmap_ros.runs.told_ways import WayInMap, way_in_map
from usmap_ros.simulation import Scenario, true_paths

PARAMETERS = PipelineParameters()
FloatArray = NDArray[np.float64]
#: A match is right that is off by no more, root mean square of what stands, m: poses of either map
#: may be off by a decimetre.
RIGHT_M = 0.6
#: Little is contradicted if that is no more of what is in common.
LITTLE = 0.03
#: Of surenesses it is said how many matches reach them.
LEAST = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0)


@dataclass(frozen=True)
class Mapped:
    """What one robot makes of where it is.

    Parameters
    ----------
    kind, seed, robot : str, int, str
        Who it is.
    pings : PingsOfFrame
        What it heard.
    map : OccupancyMap
        In its own frame.
    told_way : list of Piece
        Its way as odometry tells it; empty if that is one piece.
    origin : (3,) array
        True pose of that frame, as its way tells it: x, y (m) and yaw (rad).
    """

    kind: str
    seed: int
    robot: str
    pings: PingsOfFrame
    map: OccupancyMap
    told_way: Way
    origin: FloatArray

    def shares_place_with(self, other: Mapped) -> bool:
        """Whether both are in one place."""
        is_one_plan = self.seed == other.seed or self.kind.startswith("flat")
        return self.kind == other.kind and is_one_plan

    def __str__(self) -> str:
        return f"{self.kind} {self.seed} {self.robot}"


def mapped(scene: Scenario, kind: str, seed: int) -> list[Mapped]:
    """Robots of a scene, each by itself."""
    true = places(true_paths(scene))
    told, refined = dict[str, list[Ping]](), dict[str, list[Ping]]()
    # Robots of several scenes are not one.
    prefix = f"{kind}_{seed}_"
    pings = heard(scene, prefix)
    for first, then in zip(pings, refine_poses(pings).pings, strict=True):
        robot = first[0].split("/")[1].removeprefix(prefix)
        told.setdefault(robot, []).append(first)
        refined.setdefault(robot, []).append(then)
    found = []
    for robot, own in refined.items():
        real = (true[topic.replace(prefix, ""), cone.stamp_ns] for topic, cone in own)
        poses = [cone.pose for _, cone in own], real
        origin = laid_over(*(np.array([pose.position_m[:2] for pose in way]) for way in poses))
        pings_of = PingsOfFrame(told[robot], own, pieces_of_ways(own, PARAMETERS))
        told_way = way_of(told[robot], range(len(own)), PARAMETERS)
        told_way = told_way if len(told_way) > 1 else []
        own_map = map_of(own, PARAMETERS)
        found.append(Mapped(kind, seed, robot, pings_of, own_map, told_way, origin))
    return found


def again(match: Match | WayInMap, ours: PingsOfFrame, theirs: PingsOfFrame) -> SecondLook | None:
    """What a second look makes of a match; None if maps lie elsewhere then."""
    frames = (pings.told[0][1].frame_id for pings in (ours, theirs))
    link, kinds = Link(*frames, match.change, match.about_m), kinds_of(ours.told + theirs.told)
    return second_look(ours, theirs, link, kinds, PARAMETERS)


def said(first: Match | WayInMap, margin: float, looked: SecondLook | None, off: float) -> str:
    """How far a match is off, its margin, and what became of that."""
    then = f"{looked.match.elsewhere:.2f}" if looked else "-"
    is_sure = looked and looked.match.bears_out(first if isinstance(first, Match) else None)
    return f"{off:.2f}, {margin:.2f}: {then}" + (", sure" if is_sure else "")


def by_ways(one: Mapped, other: Mapped) -> str:
    """What a second look makes of a way in the other's map, if it is promising."""
    robots = one, other
    maps, ways = [robot.map for robot in robots], [robot.told_way for robot in robots]
    way = way_in_map([robot.pings for robot in robots], maps, ways)
    if way is None:
        return ""
    looked = again(way, way.target, way.source)
    return said(way, way.margin, looked, off_m(way, one, other))


def off_m(match: Match | WayInMap, one: Mapped, other: Mapped) -> float:
    """How far a match puts what stands in the second map from where it is."""
    if not one.shares_place_with(other):
        return math.inf
    stands_m = Submap.of(other.map).places_m
    stands = np.column_stack([stands_m, np.zeros(len(stands_m))])
    true = compose(between(one.origin, other.origin), stands)
    off = (compose(match.change, stands) - true)[:, :2]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def other_places(match: Match, one: Mapped, other: Mapped) -> str:
    """Pieces in common where maps truly lie, and elsewhere than by a match, if not contradicted."""
    first, second = Submap.of(one.map), Submap.of(other.map)

    def pieces(change: FloatArray) -> float:
        both, against = counts(first, second, change)
        return both if against <= LITTLE * both else 0.0

    ends = [end for end, _ in match.tried]
    places_m = second.places_m
    elsewhere = [end for end in ends if apart_m(places_m, end, match.change) > ELSEWHERE_M]
    most = max(map(pieces, elsewhere), default=0.0)
    if not one.shares_place_with(other):
        return f"-, {most:.0f}"
    _, true = refined(first, second, between(one.origin, other.origin))
    return f"{counts(first, second, true)[0]:.0f}, {most:.0f}"


def table(matches: list[tuple[bool, float, bool]]) -> str:
    """How many are right and wrong among those that are so sure.

    Parameters
    ----------
    matches : list of (bool, float, bool)
        Whether the place is one, how sure the match is, and whether it is right.
    """
    here = [match for match in matches if match[0]]
    lines = [
        f"{len(here)} pairs in one place, {len(matches) - len(here)} in different ones\n",
        "| sureness from | right | wrong, one place | wrong, different places |",
        "|---|---|---|---|",
    ]
    for least in LEAST:
        sure = [(is_here, is_right) for is_here, sureness, is_right in matches if sureness >= least]
        counts = (sure.count(each) for each in ((True, True), (True, False), (False, False)))
        lines.append(f"| {least:.1f} | " + " | ".join(map(str, counts)) + " |")
    return "\n".join(lines)


def main() -> None:
    """Print a line for each pair, and a table."""
    arguments = options(__doc__, [201, 202, 203]).parse_args()
    how = arguments.pings, arguments.speed, arguments.tours
    robots = [
        robot
        for kind in arguments.kinds
        for seed in arguments.seeds
        for robot in mapped(unknown_starts(kind, seed, *how), kind, seed)
    ]
    columns = "one", "other", "pieces", "margin", "against", "sureness", "off, m"
    columns += "second look", "way", "truly, elsewhere"
    print("| " + " | ".join(columns) + " |\n" + "|---" * len(columns) + "|")
    matches = []
    for one, other in combinations(robots, 2):
        match = match_maps(one.map, other.map)
        if match is None:
            continue
        off = off_m(match, one, other)
        row = f"{one} | {other} | {match.pieces:.0f} | {match.margin:.2f} | {match.against:.3f}"
        later = ""
        if first := first_look(match, one.pings.ways, other.pings.ways):
            looked = again(first, one.pings, other.pings)
            later = said(first, first.elsewhere, looked, off_m(first, one, other))
        row += f" | {match.sureness:.2f} | {off:.2f} | {later} | {by_ways(one, other)}"
        row += f" | {other_places(match, one, other)}"
        print(f"| {row} |", flush=True)
        sureness = match.sureness if match.has_enough else -math.inf
        matches.append((one.shares_place_with(other), sureness, off < RIGHT_M))
    print("\n" + table(matches))


if __name__ == "__main__":
    main()
