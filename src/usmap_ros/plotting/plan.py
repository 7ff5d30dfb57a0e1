"""What all plans of the world have in common: axes, probability, truth."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.image import AxesImage

from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.numerics.special import running_maximum
from usmap_ros.plotting import style


def draw_plane(axes: Axes) -> None:
    """Make the axes a plan of the world."""
    axes.set_facecolor(style.UNKNOWN)
    axes.grid(visible=False)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")


def draw_truth(axes: Axes, truth: TruthMap) -> None:
    """Outline all that lies within one cell of the truth, which is what counts as right."""
    limits = axes.get_xlim(), axes.get_ylim()
    margin = 2
    near = running_maximum(running_maximum(np.pad(truth.occupied, margin), 3).T, 3).T
    geometry = truth.geometry
    rows, columns = near.shape
    x = geometry.origin_m[0] + (np.arange(columns) + 0.5 - margin) * geometry.resolution_m
    y = geometry.origin_m[1] + (np.arange(rows) + 0.5 - margin) * geometry.resolution_m
    axes.contour(x, y, near.astype(float), levels=[0.5], colors=style.TRUTH, linewidths=1.0)
    axes.plot([], [], color=style.TRUTH, linewidth=1.0, label="truth, within one cell")
    # Truth beyond what is shown must not shrink the picture.
    axes.set_xlim(*limits[0])
    axes.set_ylim(*limits[1])


def draw_probability(axes: Axes, occupancy: OccupancyMap) -> AxesImage:
    """Draw a map's probability; cells never observed stay gray."""
    draw_plane(axes)
    probability = np.where(occupancy.observed, occupancy.probability(), np.nan)
    return axes.imshow(
        probability, origin="lower", extent=occupancy.geometry.extent_m,
        cmap=style.PROBABILITY, vmin=0.0, vmax=1.0, interpolation="nearest",
    )  # fmt: skip
