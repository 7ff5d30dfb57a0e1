"""Figure 6: the four paths of one object over the floor."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from usmap_ros.paper.part import Part, statement
from usmap_ros.paper.setting import CONCRETE
from usmap_ros.plotting.style import FAINT, INK, ROBOTS, TRUTH, new_figure, styled

#: Range of the object in the schematic.
RANGE_M = 4.0
#: Legs out and back: straight, or by way of the floor.
PATHS = {
    "1  direct": ("direct", "direct"),
    "2  floor first, then object": ("floor", "direct"),
    "3  object first, then floor": ("direct", "floor"),
    "4  floor, object, floor": ("floor", "floor"),
}


def four_paths() -> Part:
    """Draw the paths from the side, and compare their lengths with those that Φ is made of."""
    height_m = CONCRETE.floor_height_m
    legs_m = {"direct": RANGE_M, "floor": 2.0 * float(np.hypot(0.5 * RANGE_M, height_m))}
    lengths_m = [legs_m[out] + legs_m[back] for out, back in PATHS.values()]
    modelled_m = CONCRETE.delays_s(np.array(RANGE_M)) * CONCRETE.sound_speed_m_s
    with styled():
        figure = new_figure(9.0, 4.4)
        panels = figure.subplots(2, 2, sharex=True, sharey=True).reshape(-1)
        for axes, (name, legs), length_m in zip(panels, PATHS.items(), lengths_m, strict=True):
            _draw_scene(axes, height_m)
            # Where both touch the floor, the way out is drawn a little above it.
            lift_m = 0.1 if legs == ("floor", "floor") else 0.0
            _draw_leg(axes, legs[0], (height_m + 0.05, lift_m), ROBOTS[0], out=True)
            _draw_leg(axes, legs[1], (height_m - 0.05, 0.0), ROBOTS[1], out=False)
            axes.set_title(f"{name}: {length_m:.2f} m")
    numbers = {
        "lengths_m": dict(zip(PATHS, lengths_m, strict=True)),
        "caption": {
            "four paths, each of which the model has": statement(
                np.allclose(sorted(set(np.round(lengths_m, 9))), modelled_m),
                model_m=modelled_m.tolist(),
            ),
            "paths 2 and 3 have one length": statement(lengths_m[1] == lengths_m[2]),
        },
    }
    return Part("figure_6_four_paths", numbers, figure)


def _draw_scene(axes: Axes, height_m: float) -> None:
    axes.axhspan(-0.25, 0.0, color="#e3e8ec", zorder=0)
    axes.axhline(0.0, color=FAINT, linewidth=1.5)
    axes.plot(0.0, height_m, marker=(3, 0, -90), color=INK, markersize=13, zorder=5)
    axes.plot(RANGE_M, height_m, "o", color=TRUTH, markersize=10, zorder=5)
    axes.text(0.0, height_m + 0.2, "transducer", ha="center", fontsize=8)
    axes.text(RANGE_M, height_m + 0.2, "object", ha="center", fontsize=8)
    axes.text(0.02, -0.08, "floor", va="center", fontsize=8, color=INK)
    axes.set(xlim=(-0.6, RANGE_M + 0.6), ylim=(-0.25, height_m + 0.5))
    axes.set_axis_off()


def _draw_leg(
    axes: Axes, leg: str, heights_m: tuple[float, float], color: str, *, out: bool
) -> None:
    """Draw one leg with arrows along it; `heights_m` are those of its ends and of the floor."""
    x, y = [0.15, RANGE_M - 0.15], [heights_m[0]] * 2
    if leg == "floor":
        x, y = [x[0], 0.5 * RANGE_M, x[1]], [y[0], heights_m[1], y[1]]
    if not out:
        x, y = x[::-1], y[::-1]
    axes.plot(x, y, color=color, linewidth=1.8)
    for start in range(len(x) - 1):
        (x0, x1), (y0, y1) = x[start : start + 2], y[start : start + 2]
        axes.annotate(
            "",
            (0.48 * x0 + 0.52 * x1, 0.48 * y0 + 0.52 * y1),
            (0.5 * (x0 + x1), 0.5 * (y0 + y1)),
            arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.8},
        )
