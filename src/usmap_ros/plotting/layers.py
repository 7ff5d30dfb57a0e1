"""What a map knows beside its belief, drawn on a plan: normals, and how undecided cells are."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.image import AxesImage

from usmap_ros.grids import AMBIGUITY, NORMAL, OccupancyMap
from usmap_ros.plotting import style
from usmap_ros.plotting.plan import draw_plane, draw_probability

#: Length of the tick that shows a normal, in cells.
_TICK_CELLS = 3.0


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
