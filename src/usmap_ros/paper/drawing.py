"""What several of the paper's pictures share."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.numerics.arrays import FloatArray, Signal
from usmap_ros.numerics.geometry import Pose
from usmap_ros.paper.setting import MAX_RANGE_M, Points
from usmap_ros.plotting.style import FAINT, INK, RESIDUAL, SIGNAL, TRUTH
from usmap_ros.reconstruction.cone_cells import ConeCells

#: Of coefficients: nothing is paper, an ideal object is ink.
COEFFICIENT = LinearSegmentedColormap.from_list(
    "coefficient", ["#f6f8fa", "#f4b860", "#d1495b", "#1d1135"]
)


def draw_cells(
    axes: Axes, cells: ConeCells, values: FloatArray, largest: float = 1.0
) -> PatchCollection:
    """Draw the cells of a cone as squares, coloured by their values."""
    corners = cells.centers_m - 0.5 * cells.resolution_m
    side = cells.resolution_m
    squares = PatchCollection(
        [Rectangle((x, y), side, side) for x, y in corners],
        cmap=COEFFICIENT,
        norm=Normalize(0.0, largest),
        edgecolor="#d3dae0" if side > 0.2 else "none",
        linewidth=0.5,
    )
    squares.set_array(values)
    axes.add_collection(squares)
    return squares


def draw_cone_edge(
    axes: Axes, pose: Pose, max_range_m: float = MAX_RANGE_M, color: str = FAINT, label: str = ""
) -> None:
    """Draw the edge of a sensing cone, and the transducer at its tip."""
    half = BeamPattern.linear().half_angle_rad
    angles = pose.yaw_rad + np.linspace(-half, half, 60)
    x, y = pose.position_m[:2]
    arc = x + max_range_m * np.cos(angles), y + max_range_m * np.sin(angles)
    axes.plot([x, *arc[0], x], [y, *arc[1], y], color=color, linewidth=1.0, zorder=3)
    heading = float(np.rad2deg(pose.yaw_rad)) - 90.0
    axes.plot(
        x,
        y,
        marker=(3, 0, heading),
        color=color,
        markersize=10,
        linestyle="none",
        label=label or "transducer",
        zorder=5,
    )


def draw_objects(axes: Axes, objects: Points, images: Points = ()) -> None:
    """Ring the objects, and, dashed, their mirror images."""
    ring: Any = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "zorder": 6}
    axes.plot(
        *np.transpose(objects),
        markersize=13,
        markeredgecolor=TRUTH,
        markeredgewidth=2.0,
        label="object",
        **ring,
    )
    if len(images):
        axes.plot(
            *np.transpose(images),
            markersize=13,
            markeredgecolor=RESIDUAL,
            markeredgewidth=1.2,
            label="mirror image",
            **ring,
        )


def finish_map(axes: Axes, title: str) -> None:
    """Set up the axes of a map in metres."""
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_title(title)
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=7, integer=True))
    axes.grid(visible=False)


def draw_signal(
    axes: Axes, times_s: FloatArray, signal: Signal, label: str, color: str = SIGNAL
) -> None:
    """Draw a signal over time in milliseconds."""
    axes.plot(1e3 * times_s, signal, color=color, linewidth=0.8, label=label)
    axes.set_xlabel("delay (ms)")
    axes.set_ylabel("amplitude")
    axes.margins(x=0.0)


def annotate(axes: Axes, text: str) -> None:
    """Put a note into the upper left corner."""
    axes.text(
        0.02,
        0.97,
        text,
        transform=axes.transAxes,
        ha="left",
        va="top",
        fontsize=8,
        color=INK,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 2.0},
    )


def share_legend(figure: Figure, axes: Axes) -> None:
    """Put one legend for all panels below them, from what is drawn in one."""
    handles, labels = axes.get_legend_handles_labels()
    legend = figure.legend(handles, labels, loc="outside lower center", ncols=4)
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D):
            handle.set_markersize(7.0)
