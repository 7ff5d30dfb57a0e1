"""What maps at the default settings are to reach, by kind of scene."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

from scenes import KINDS

#: Scene and condition, as in `scenes`.
Pair = tuple[str, str]


@dataclass(frozen=True)
class Target:
    """What means over seeds and scenes are to reach.

    Parameters
    ----------
    shown : str
        The scenes in words.
    cases : tuple of (scene, condition)
        Which they are.
    f1, known, known_audible : float
        At least; 0: whatever it is.
    leak, lost, escape_m2 : float
        At most.
    """

    shown: str
    cases: tuple[Pair, ...]
    f1: float
    known: float = 0.0
    known_audible: float = 0.0
    leak: float = 0.02
    lost: float = 0.03
    escape_m2: float = 0.1

    def bound(self, name: str) -> str:
        """The bound of a figure in words; empty if it has none."""
        value = getattr(self, name, None)
        if not value:
            return ""
        return f"≥ {value:g}" if name in AT_LEAST else f"≤ {value:g}"

    def is_missed(self, name: str, value: float) -> bool:
        """Whether a figure is on the wrong side of its bound."""
        bound = getattr(self, name, None)
        if bound is None:
            return False
        return value < bound if name in AT_LEAST else value > bound


#: Of the bounds, those from below.
AT_LEAST = ("f1", "known", "known_audible")


def _plain(*scenes: str) -> tuple[Pair, ...]:
    return tuple(product(scenes, ["plain"]))


TARGETS: tuple[Target, ...] = (
    Target("poles, 3 × 100 pings", (("poles", "100_pings"),), 0.99, 0.97, 0.97),
    Target("poles, 3 × 30 pings", (("poles", "few_pings"),), 0.88, 0.75, 0.75),
    Target("poles, noise 0.04", (("poles", "100_noisy"),), 0.98),
    Target("poles, poses off", (("poles", "100_poses_off"),), 0.97),
    Target("poles, floor", (("poles", "100_floor"),), 0.96),
    Target("poles, sound 2 % slower than stated", (("poles", "sound_off"),), 0.99, 0.97, 0.97),
    Target("poles, traces 0.3 ms late", (("poles", "told_late"),), 0.99, 0.97, 0.97),
    Target("poles, poses 0.1 s late", (("poles", "poses_late"),), 0.99, 0.97, 0.97),
    Target("turned smooth rooms, poses 0.1 s late", (("turned_smooth", "poses_late"),), 0.0),
    Target("turned smooth rooms, sound 2 % slower", (("turned_smooth", "sound_off"),), 0.0),
    # As far below those that did not stand as may be.
    Target("poles, 30 s of standing first", (("poles", "100_parked"),), 0.98, 0.96, 0.96),
    Target("flat, rough walls", _plain("flat_rough"), 0.90, 0.92),
    Target("flat, smooth walls", _plain("flat_smooth"), 0.77, 0.63),
    Target("round columns, half smooth", _plain("columns_rough", "columns_smooth"), 0.82, 0.70),
    Target("turned rooms, half smooth", _plain("turned_rough", "turned_smooth"), 0.82, 0.77),
    Target("some walls of glass, others rough", _plain("panes"), 0.0),
    Target("hexagon with nine columns", _plain("arena"), 0.95, 0.95),
    Target("depot", _plain("depot"), 0.86, 0.70),
    Target("warehouse, sparsely visited", _plain("warehouse"), 0.68, 0.65, lost=0.05),
    Target("corridors", _plain("corridors"), 0.0),
    Target("swarm of range sensors", (("swarm", "ranges"),), 0.90, 0.93, lost=0.02),
    Target("the same as traces", (("swarm", "range_traces"),), 0.90, 0.93, lost=0.02),
    Target("sonars' first echoes alone, rough", (("flat_rough", "first_echoes"),), 0.0),
    Target("sonars' first echoes alone, smooth", (("flat_smooth", "first_echoes"),), 0.0),
)
# Nav2's own world is not always at hand.
if "sandbox" in KINDS:
    TARGETS += (Target("sandbox", _plain("sandbox"), 0.95, 0.95),)
