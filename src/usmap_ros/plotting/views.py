"""Picture of the poses from which to ping next, on what is undecided."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from usmap_ros.grids import AMBIGUITY, OccupancyMap
from usmap_ros.mapping.next_view import NextView
from usmap_ros.plotting import style
from usmap_ros.plotting.map import map_figure

#: Length of the sides of a drawn cone, m.
_SIDE_M = 0.4


def views_figure(
    occupancy: OccupancyMap, views: Sequence[NextView], half_angle_rad: float
) -> Figure:
    """Draw poses on a map's ambiguity, each with its cone and its rank.

    Parameters
    ----------
    occupancy : OccupancyMap
        With the layer `ambiguity`.
    views : sequence of NextView
        Poses to ping from next, the best first.
    half_angle_rad : float
        Of the cone.
    """
    figure = map_figure(occupancy, title="Where to ping next", layer=AMBIGUITY)
    axes = figure.axes[0]
    for rank, view in enumerate(views, start=1):
        edges = view.yaw_rad + half_angle_rad * np.array([-1.0, 1.0])
        x = view.x_m + _SIDE_M * np.array([np.cos(edges[0]), 0.0, np.cos(edges[1])])
        y = view.y_m + _SIDE_M * np.array([np.sin(edges[0]), 0.0, np.sin(edges[1])])
        axes.plot(x, y, color=style.RECONSTRUCTION)
        axes.annotate(
            str(rank), (view.x_m, view.y_m), textcoords="offset points", xytext=(-4.0, -4.0),
            ha="right", va="top", color=style.RECONSTRUCTION, annotation_clip=True,
        )  # fmt: skip
    return figure
