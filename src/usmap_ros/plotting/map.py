"""Picture of a fused map, with the paths of the robots that made it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usmap_ros.grids import GridGeometry, OccupancyMap, TruthMap
from usmap_ros.io.map_files import RobotPaths
from usmap_ros.plotting import style
from usmap_ros.plotting.plan import draw_probability, draw_truth

_LONG_SIDE_IN = 7.0


def map_figure(
    occupancy: OccupancyMap,
    paths: RobotPaths | None = None,
    truth: TruthMap | None = None,
    title: str = "Fused map",
) -> Figure:
    """Draw a map as probability.

    Parameters
    ----------
    occupancy : OccupancyMap
        The map.
    paths : RobotPaths, optional
        Where the robots were.
    truth : TruthMap, optional
        Drawn as an outline.
    title : str
        What stands above it.
    """
    with style.styled():
        shown = occupancy.observed_geometry()
        figure = style.new_figure(*figure_size_in(shown))
        axes = figure.subplots()
        image = draw_probability(axes, occupancy)
        if truth is not None:
            draw_truth(axes, truth)
        draw_paths(axes, paths or RobotPaths())
        show_all(axes, shown, paths or RobotPaths())
        axes.set_title(title)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.07), ncols=5)
        figure.colorbar(image, ax=axes, shrink=0.6, label="probability of being occupied")
    return figure


def figure_size_in(geometry: GridGeometry) -> tuple[float, float]:
    """Size of a figure that a map fills, with room for its colour bar, legend and labels."""
    rows, columns = geometry.shape
    scale = _LONG_SIDE_IN / max(rows, columns)
    return max(columns * scale, 3.0) + 1.9, max(rows * scale, 3.0) + 0.8


def show_all(axes: Axes, geometry: GridGeometry, paths: RobotPaths) -> None:
    """Set the limits of the axes to hold a map and all paths, which may lead out of it."""
    x_min, x_max, y_min, y_max = geometry.extent_m
    corners_m = [[(x_min, y_min), (x_max, y_max)], *paths.positions_m.values()]
    points_m = np.concatenate([np.reshape(positions, (-1, 2)) for positions in corners_m])
    (x_min, y_min), (x_max, y_max) = points_m.min(axis=0), points_m.max(axis=0)
    margin_m = 2.0 * geometry.resolution_m
    axes.set_xlim(x_min - margin_m, x_max + margin_m)
    axes.set_ylim(y_min - margin_m, y_max + margin_m)


def draw_paths(axes: Axes, paths: RobotPaths) -> None:
    """Draw each transducer's path, with a dot where it ends."""
    for number, (topic, positions_m) in enumerate(sorted(paths.positions_m.items())):
        color = style.robot_color(number)
        x, y = np.transpose(positions_m)
        axes.plot(x, y, color=color, linewidth=1.2, alpha=0.85, label=topic)
        axes.plot(x[-1:], y[-1:], color=color, marker="o", markersize=5, linestyle="none")
