"""Parts of the product's map, and what stands in the place of each when it is left out.

The product has no switches for them: functions and numbers of it are put aside for the time of a
map, as `stages` does to see how long they take.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint import estimate, sensors
from usmap_ros.mapping.joint.free_space import (
    behind,
    continuations,
    free_space,
    listening,
    open_rays,
    refutation,
    response,
    rounds,
    silence,
    usual_directions,
)
from usmap_ros.mapping.joint.free_space.continuations import Continuations
from usmap_ros.mapping.joint.free_space.kinds import ORIENTATIONS, ROUND
from usmap_ros.mapping.joint.free_space.usual_directions import WallDirections
from usmap_ros.mapping.joint.surfaces import (
    alike_columns,
    mirror_walls,
    smooth_surfaces,
    walls,
)
from usmap_ros.mapping.joint.surfaces import parts as place_parts
from usmap_ros.mapping.joint.surfaces.panes import NO_LONE_LINES
from usmap_ros.mapping.ping_table import NOISE, PingTable
from usmap_ros.numerics.arrays import FloatArray

#: Where it stands, what it is called, and what stands there instead.
Instead = tuple[Any, str, Any]


@dataclass(frozen=True)
class Part:
    """A part of the product.

    Parameters
    ----------
    shown : str
        What maps are without it, in words.
    instead : tuple of Instead
        What stands in its place when it is left out.
    settings : dict
        Parameters that leave it out, as in `methods.Method`.
    """

    shown: str
    instead: tuple[Instead, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)


@contextmanager
def left_out(instead: tuple[Instead, ...]) -> Iterator[None]:
    """Put something else in some places meanwhile."""
    with ExitStack() as stack:
        for owner, name, other in instead:
            stack.enter_context(patch.object(owner, name, other))
        yield


class _AsFound:
    """Smooth walls that end where their feet do."""

    def __init__(self, *given: Any) -> None:
        *_, self._walls, _ = given

    def extended(self) -> list[Any]:
        """The walls as they were found."""
        return list(self._walls)


def _none_like(place: int) -> Callable[..., NDArray[np.bool_]]:
    """Give a function that finds no cells, of the shape of one of its arguments."""
    return lambda *given: np.zeros(given[place].shape[:2], bool)


def _ending(lines: FloatArray, *given: Any) -> Continuations:
    """Lines that end where they were found to."""
    return Continuations(lines, _none_like(0)(*given))


def _by_noise(
    table: PingTable, pings: NDArray[np.int64], expected: NDArray[np.float32], reach: int
) -> response.HeardBins:
    """What was heard where nothing is expected to be."""
    noise = np.repeat(table.numbers[pings, NOISE, np.newaxis], expected.shape[1], axis=1)
    return response.listen(table, pings, noise.astype(np.float32), reach)


def _anywhere(_: WallDirections, mirrors: int, *given: Any) -> FloatArray:
    """Orientations as they are asked for where no smooth walls are."""
    nothing = WallDirections(*np.zeros((3, 0)))
    return usual_directions.log_priors(nothing, 0, *given)


def _none_of(kinds: slice) -> Callable[..., FloatArray]:
    """Give a function that asks for no surfaces of some kinds."""

    def log_priors(*given: Any) -> FloatArray:
        priors = usual_directions.log_priors(*given)
        priors[kinds, 1] = usual_directions.NEVER
        return priors

    return log_priors


def _none(*given: Any) -> list[Any]:
    """Find nothing."""
    return []


PARTS = {
    "occlusion": Part("nothing hides anything", settings={"mapping.occlusion": False}),
    "forgetting": Part("nothing is forgotten", settings={"mapping.forgetting": 0.0}),
    "key_pings": Part("all pings settle what hides what", ((estimate, "MOST_KEY_SHARE", 0.0),)),
    "lines": Part("no lines through believed cells", settings={"mapping.wall_gap_m": 0.0}),
    "doubles": Part(
        "ghosts beside lines stay",
        ((walls, "without_doubles", lambda lines: lines), (walls, "GHOST_MARGIN", -np.inf)),
    ),
    "mirrors": Part("no smooth walls", ((place_parts, "mirror_walls", _none),)),
    "usual_mirrors": Part(
        "smooth walls all need as many hits",
        ((mirror_walls, "face_usually", lambda found, among: np.zeros(len(found), bool)),),
    ),
    "fainter": Part("smooth walls are as loud as most", ((mirror_walls, "FAINTER", 0.4),)),
    "cuts": Part("a place has no parts", ((place_parts, "CUTS", 0),)),
    "images": Part(
        "images in mirrors are walls",
        ((mirror_walls, "seen_directly", lambda walls, *given: walls),),
    ),
    "panes": Part(
        "no mirrors are expected among rough walls",
        ((smooth_surfaces, "lone_lines", lambda *given: NO_LONE_LINES),),
    ),
    "wall_ends": Part("smooth walls end at their feet", ((smooth_surfaces, "WallEnds", _AsFound),)),
    "columns": Part("no round columns", ((smooth_surfaces, "columns_of_place", _none),)),
    "alike": Part(
        "columns tell nothing of each other",
        ((alike_columns, "several_alike", lambda *given: None),),
    ),
    "lone_points": Part(
        "exact ranges tell of no points",
        ((smooth_surfaces, "lone_points", lambda *given: np.zeros((0, 2))),),
    ),
    "taken_out": Part(
        "echoes of smooth things stay",
        ((smooth_surfaces.SmoothSurfaces, "take_out", lambda things: None),),
    ),
    "going_on": Part(
        "rough walls do not go on",
        ((continuations, "continue_lines", _ending),),
    ),
    "meeting": Part(
        "walls do not go on until they meet",
        ((continuations, "joined", lambda lines, *given: lines),),
    ),
    "behind": Part(
        "nothing is solid behind what one side heard",
        tuple((behind, name, _none_like(1)) for name in ("behind", "behind_alone")),
    ),
    "explained": Part(
        "echoes that what is shown explains count", ((listening, "listen", _by_noise),)
    ),
    "grazing": Part(
        "grazing silence is not learnt from", ((response, "SMOOTH", 8.0), (response, "ROUGH", 9.0))
    ),
    "overdispersion": Part(
        "each silent look counts", ((silence, "learn_shape", lambda *given: 1e6),)
    ),
    "directions": Part("surfaces face anywhere", ((silence, "log_priors", _anywhere),)),
    "room": Part("walls need no room", ((refutation, "lacks_room", _none_like(0)),)),
    "round": Part(
        "nothing round is asked for", ((silence, "log_priors", _none_of(slice(ROUND, None))),)
    ),
    "unfound_mirrors": Part(
        "mirrors that nobody found are not asked for",
        ((silence, "log_priors", _none_of(slice(ORIENTATIONS, ROUND))),),
    ),
    "open_rays": Part(
        "rays that end at nothing say nothing",
        ((open_rays, "FEW_OPEN", 8.0), (open_rays, "MANY_OPEN", 9.0)),
    ),
    "proofs": Part("free by silence alone", settings={"mapping.proof_rays": 1000.0}),
    "rounds": Part("one round of free space", ((free_space, "FREE_ROUNDS", 1),)),
    "ended": Part(
        "echoes as loud as mirrors' let sound through",
        ((free_space, "end_rays", lambda *given: None),),
    ),
    "recesses": Part(
        "no side of a recess is shorter than walls are", ((rounds, "may_be_short", _none_like(3)),)
    ),
    "floors": Part("floors are things", ((sensors, "clutter_of", lambda cones: {}),)),
    "slits": Part("slits may be free", ((rounds, "without_slits", lambda free, *given: free),)),
    "connected": Part(
        "free without a way there", ((free_space, "led_to", lambda free, *given: free),)
    ),
}
