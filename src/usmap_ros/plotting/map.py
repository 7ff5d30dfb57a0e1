"""Picture of a fused map, with the paths of its robots and with what it knows beside its belief."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Patch

from usmap_ros.grids import AMBIGUITY, NORMAL, OccupancyMap, TruthMap
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.pings.trajectory import Trajectory
from usmap_ros.plotting import style
from usmap_ros.plotting.plan import draw_plane, draw_probability, draw_truth
from usmap_ros.plotting.shown import Extent, shown_extent

_LONG_SIDE_IN = 7.0
#: Length of the tick that shows a normal, in cells.
_TICK_CELLS = 3.0


def map_figure(
    occupancy: OccupancyMap,
    paths: RobotPaths | None = None,
    truth: TruthMap | None = None,
    title: str = "Fused map",
    extent_m: Extent | None = None,
    layer: str | None = None,
    told: Mapping[str, Trajectory] | None = None,
) -> Figure:
    """Draw a map as probability, or one of its layers.

    Parameters
    ----------
    occupancy : OccupancyMap
        The map that is drawn, cell by cell.
    paths : RobotPaths, optional
        Where the robots were.
    truth : TruthMap, optional
        Drawn as an outline.
    title : str
        What stands above it.
    extent_m : (x_min, x_max, y_min, y_max), optional
        What is shown, so that pictures can be compared; by default what was observed and all
        paths.
    layer : str, optional
        One of `usmap_ros.grids.LAYERS`: normals as ticks on the probability, others instead of it.
    told : mapping of str to Trajectory, optional
        Paths by topic as odometry told them, drawn dashed from where the others begin.

    Raises
    ------
    ValueError
        If the map does not have the layer.
    """
    paths = paths or RobotPaths()
    with style.styled():
        shown = extent_m or shown_extent([occupancy], paths)
        figure = style.new_figure(*figure_size_in(shown))
        axes = figure.subplots()
        if layer is None:
            image, meaning = draw_probability(axes, occupancy), "probability of being occupied"
        else:
            image, meaning = draw_layer(axes, occupancy, layer)
        axes.set_xlim(*shown[:2])
        axes.set_ylim(*shown[2:])
        if truth is not None:
            draw_truth(axes, truth)
        draw_paths(axes, paths)
        _draw_told(axes, paths, told or {})
        axes.set_title(title)
        draw_legend(figure, axes, paper="decided" if layer == AMBIGUITY else "free")
        figure.colorbar(image, ax=axes, shrink=0.6, label=meaning)
    return figure


def figure_size_in(extent_m: Extent) -> tuple[float, float]:
    """Size of a figure that a map fills, with room for its colour bar, legend and labels."""
    x_min, x_max, y_min, y_max = extent_m
    scale = _LONG_SIDE_IN / max(x_max - x_min, y_max - y_min)
    return max((x_max - x_min) * scale, 4.0) + 1.9, max((y_max - y_min) * scale, 3.0) + 1.3


def draw_paths(axes: Axes, paths: RobotPaths) -> None:
    """Draw each transducer's path, with a dot where it ends."""
    for number, (topic, positions_m) in enumerate(sorted(paths.positions_m.items())):
        color = style.robot_color(number)
        x, y = np.transpose(positions_m)
        axes.plot(x, y, color=color, linewidth=1.2, alpha=0.85, label=robot_name(topic))
        axes.plot(x[-1:], y[-1:], color=color, marker="o", markersize=5, linestyle="none")


def _draw_told(axes: Axes, paths: RobotPaths, told: Mapping[str, Trajectory]) -> None:
    """Draw where odometry took transducers to go."""
    label = "as told"
    for number, (topic, path) in enumerate(sorted(paths.trajectories().items())):
        if topic in told and len(told[topic]):
            start = Pose(path.positions_m[0], path.orientations[0])
            x, y = told[topic].begun_at(start).T
            axes.plot(x, y, color=style.robot_color(number), linewidth=0.9, ls="--", label=label)
            # Explained once.
            label = "_"


def draw_legend(figure: Figure, axes: Axes, paper: str = "free") -> None:
    """Say below a map what is drawn on it, and what its paper and its grey mean."""
    handles, labels = axes.get_legend_handles_labels()
    handles = [
        Patch(facecolor="white", edgecolor=style.FAINT),
        Patch(facecolor=style.UNKNOWN, edgecolor=style.FAINT),
        *handles,
    ]
    style.legend_below(figure, handles, [paper, "unknown", *labels], columns=7)


def robot_name(topic: str) -> str:
    """The robot that a topic is of, and its transducer if the topic names one.

    ``/robot1/echo`` is robot1's, ``/robot1/left/echo`` that of its transducer "left".
    """
    parts = topic.strip("/").split("/")
    return " ".join(parts[:-1]) or topic


def draw_layer(axes: Axes, occupancy: OccupancyMap, layer: str) -> tuple[AxesImage, str]:
    """Draw a layer, and return the image with what its colours mean.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Becomes a plan of the world.
    occupancy : OccupancyMap
        A map that has the layer.
    layer : str
        One of `usmap_ros.grids.LAYERS`: normals are drawn as ticks on the map's probability.

    Raises
    ------
    ValueError
        If the map does not have it.
    """
    if layer not in occupancy.layers:
        raise ValueError(f"has no layer {layer}")
    if layer == AMBIGUITY:
        return _draw_ambiguity(axes, occupancy), "how undecided"
    image = draw_probability(axes, occupancy)
    draw_normals(axes, occupancy)
    return image, "probability of being occupied"


def draw_normals(axes: Axes, occupancy: OccupancyMap) -> None:
    """Draw a short tick from every cell whose normal is known, to where its surface faces."""
    normal_rad = occupancy.layers[NORMAL]
    rows, columns = np.nonzero(np.isfinite(normal_rad))
    start_m = occupancy.geometry.cell_centers_m(rows, columns)
    angle = normal_rad[rows, columns].astype(float)
    tick_m = _TICK_CELLS * occupancy.geometry.resolution_m
    end_m = start_m + tick_m * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    # One line for all, interrupted between them.
    gap = np.full_like(start_m, np.nan)
    x, y = np.stack([start_m, end_m, gap], axis=1).reshape(-1, 2).T
    axes.plot(x, y, color=style.SIGNAL, linewidth=0.8, label="faces")


def _draw_ambiguity(axes: Axes, occupancy: OccupancyMap) -> AxesImage:
    """Draw how undecided cells are; those neither observed nor suspected stay gray."""
    draw_plane(axes)
    ambiguity = occupancy.layers[AMBIGUITY]
    values = np.where(occupancy.observed | (ambiguity > 0.0), ambiguity, np.nan)
    return axes.imshow(
        values, origin="lower", extent=occupancy.geometry.extent_m,
        cmap=style.AMBIGUITY, vmin=0.0, vmax=1.0, interpolation="nearest",
    )  # fmt: skip
