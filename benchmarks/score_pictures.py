"""Pictures of scores: all methods' maps of a scene side by side, and figures by scene."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch
from methods import METHODS
from scipy.ndimage import binary_dilation

from usmap_ros.evaluation.alignment import align
from usmap_ros.evaluation.line_of_sight import pings_in_sight
from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.pings.fields_of_view import PingViews
from usmap_ros.plotting import style
from usmap_ros.plotting.plan import draw_probability, draw_truth
from usmap_ros.plotting.style import save_figure

#: Of cells called free that no beam can have reached.
LEAKED = "#e58fb1"
#: Figures that are drawn: what they are called, and their field.
DRAWN = {
    "F1": "f1", "known": "known", "leak": "leak", "lost": "lost", "escape (m²)": "escape_m2",
}  # fmt: skip
_COLUMNS = 4


def draw_maps(maps: dict[str, OccupancyMap], truth: TruthMap, views: PingViews, path: Path) -> None:
    """All maps of a scene, with the truth, the pings, and what leaked.

    Parameters
    ----------
    maps : dict
        By what is to stand above them.
    truth : TruthMap
        What is there.
    views : PingViews
        What the pings looked at.
    path : path
        The picture's file.
    """
    with style.styled():
        across = min(_COLUMNS, len(maps))
        down = -(-len(maps) // across)
        x_min, x_max, y_min, y_max = truth.geometry.extent_m
        tall = 3.6 * (y_max - y_min) / (x_max - x_min)
        figure = style.new_figure(3.6 * across, (tall + 0.5) * down + 0.4, 110)
        for axes in figure.subplots(down, across, squeeze=False).flat:
            axes.set_visible(False)
        for axes, (title, occupancy) in zip(figure.axes, maps.items(), strict=False):
            axes.set_visible(True)
            draw_probability(axes, occupancy)
            _draw_leak(axes, occupancy, truth, views)
            axes.plot(*views.positions_m.T, ".", color=style.ROBOTS[0], markersize=1.0)
            axes.set_xlim(x_min - 1.0, x_max + 1.0)
            axes.set_ylim(y_min - 1.0, y_max + 1.0)
            draw_truth(axes, truth)
            axes.set_title(title)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        handles += [Patch(color=LEAKED), Patch(color=style.UNKNOWN)]
        labels += ["free, though no beam can have reached it", "unknown"]
        style.legend_below(figure, handles, labels, columns=3)
    save_figure(figure, path)


def _draw_leak(axes: Axes, occupancy: OccupancyMap, truth: TruthMap, views: PingViews) -> None:
    maps = align(occupancy, truth)
    seen = pings_in_sight(maps.occupied, maps.geometry, views) > 0
    leaked = maps.free & ~binary_dilation(seen, np.ones((3, 3), dtype=bool))
    axes.imshow(
        np.where(leaked, 1.0, np.nan), origin="lower", extent=maps.geometry.extent_m,
        cmap=ListedColormap([LEAKED]), interpolation="nearest",
    )  # fmt: skip


def draw_scores(rows: list[dict[str, Any]], path: Path) -> None:
    """Figures of every scene and method, means with standard deviations over the seeds.

    Parameters
    ----------
    rows : list of dict
        As `scores.summary` gives them.
    path : path
        The picture's file.
    """
    scenes = list(dict.fromkeys((row["scene"], row["condition"]) for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    with style.styled():
        figure = style.new_figure(max(9.0, 2.5 + 0.75 * len(scenes)), 2.2 * len(DRAWN))
        for axes, (label, name) in zip(
            figure.subplots(len(DRAWN), 1, sharex=True), DRAWN.items(), strict=True
        ):
            for number, method in enumerate(methods):
                own = [row for row in rows if row["method"] == method]
                x = np.array([scenes.index((row["scene"], row["condition"])) for row in own])
                shift = 0.7 * ((number + 0.5) / len(methods) - 0.5)
                axes.errorbar(
                    x + shift, [row[name] for row in own], [row[f"{name}_std"] for row in own],
                    fmt="o", markersize=3.5, linewidth=1.0, label=METHODS[method].shown,
                    color=style.robot_color(number),
                )  # fmt: skip
            axes.set_ylabel(label)
        axes = figure.axes[-1]
        titles = [
            scene.replace("_", " ") + ("" if condition == "plain" else f",\n{condition}")
            for scene, condition in scenes
        ]
        axes.set_xticks(range(len(scenes)), [title.replace("_", " ") for title in titles],
                        rotation=45, ha="right")  # fmt: skip
        style.legend_below(figure, *axes.get_legend_handles_labels(), columns=3)
    save_figure(figure, path)
