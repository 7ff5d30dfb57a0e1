"""Picture of one sensing cone: where the echoes of one ping may have come from."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Arc, Wedge
from matplotlib.path import Path

from usmap_ros.grids import GridGeometry, TruthMap
from usmap_ros.mapping.candidates import CandidateCells
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.cone import EchoCone
from usmap_ros.plotting import style
from usmap_ros.plotting.plan import draw_plane, draw_truth

#: Points to the right, where a transducer at angle 0 looks.
_ARROW = Path([(1.0, 0.0), (-0.8, 0.6), (-0.4, 0.0), (-0.8, -0.6), (1.0, 0.0)])
LIKELIHOOD_LABEL = "likelihood, relative to the best cell of the echo"
_ECHO_LINE: dict[str, Any] = {"color": style.RECONSTRUCTION, "linewidth": 0.6, "alpha": 0.6}
#: Free space around the cone, m.
_MARGIN_M = 0.25


def cone_figure(
    cone: EchoCone, candidates: CandidateCells, truth: TruthMap | None = None
) -> Figure:
    """Draw a cone with its candidate cells.

    Parameters
    ----------
    cone : EchoCone
        One ping's echoes, pose and beam.
    candidates : CandidateCells
        Cells that may have returned its echoes.
    truth : TruthMap, optional
        What is really there.
    """
    with style.styled():
        figure = style.new_figure(6.4, 5.6)
        axes = figure.subplots()
        image = draw_cone(axes, cone, candidates, truth)
        figure.colorbar(image, ax=axes, shrink=0.8, label=LIKELIHOOD_LABEL)
    return figure


def draw_cone(
    axes: Axes, cone: EchoCone, candidates: CandidateCells, truth: TruthMap | None
) -> AxesImage:
    """Draw a cone into `axes`; returns the image that a colour bar explains."""
    position_m, yaw_deg = cone.pose.position_m[:2], np.degrees(cone.pose.yaw_rad)
    half_deg = np.degrees(cone.transducer.beam.half_angle_rad)
    draw_plane(axes)
    transducer = cone.transducer
    axes.add_patch(
        Wedge(
            (position_m[0], position_m[1]), transducer.max_range_m,
            yaw_deg - half_deg, yaw_deg + half_deg,
            facecolor="white", edgecolor=style.FAINT, linewidth=1.0, zorder=0.5,
        )
    )  # fmt: skip
    image = _draw_candidates(axes, candidates)
    for range_m in cone.ranges_m:
        axes.add_patch(
            Arc(
                (position_m[0], position_m[1]), 2 * range_m, 2 * range_m,
                angle=yaw_deg, theta1=-half_deg, theta2=half_deg, **_ECHO_LINE,
            )
        )  # fmt: skip
    axes.plot([], [], label="range of an echo", **_ECHO_LINE)
    if truth is not None:
        draw_truth(axes, truth)
    axes.plot(
        *position_m, marker=MarkerStyle(_ARROW).rotated(deg=float(yaw_deg)), markersize=12,
        color=style.INK, linestyle="none", label="transducer",
    )  # fmt: skip
    _zoom(axes, cone)
    axes.set_title(
        f"Cone of {cone.child_frame_id}: {style.counted(len(cone.ranges_m), 'echo', 'echoes')}"
    )
    # Below the axis and its label, however tall the plan is.
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, 0.0), borderaxespad=4.5, ncols=2)
    return image


def _draw_candidates(axes: Axes, candidates: CandidateCells) -> AxesImage:
    """Draw candidate cells as an image of the box around them."""
    rows, columns = candidates.rows, candidates.columns
    # Without a candidate, one empty cell carries the colour scale.
    first_row, last_row = (int(rows.min()), int(rows.max())) if len(rows) else (0, 0)
    first_column, last_column = (int(columns.min()), int(columns.max())) if len(rows) else (0, 0)
    shape = (last_row - first_row + 1, last_column - first_column + 1)
    likelihood = np.full(shape, np.nan)
    likelihood[rows - first_row, columns - first_column] = candidates.likelihood
    side_m = candidates.resolution_m
    geometry = GridGeometry(side_m, (first_column * side_m, first_row * side_m), shape)
    return axes.imshow(
        likelihood, origin="lower", extent=geometry.extent_m, cmap=style.LIKELIHOOD,
        vmin=0.0, vmax=1.0, interpolation="nearest", zorder=1.0,
    )  # fmt: skip


def _zoom(axes: Axes, cone: EchoCone) -> None:
    outline_m = _outline(cone)
    (x_min, y_min), (x_max, y_max) = outline_m.min(axis=0), outline_m.max(axis=0)
    axes.set_xlim(x_min - _MARGIN_M, x_max + _MARGIN_M)
    axes.set_ylim(y_min - _MARGIN_M, y_max + _MARGIN_M)


def _outline(cone: EchoCone) -> FloatArray:
    """Points on the outline of a cone, (n, 2)."""
    half = cone.transducer.beam.half_angle_rad
    angles = cone.pose.yaw_rad + np.linspace(-half, half, 65)
    arc = np.column_stack([np.cos(angles), np.sin(angles)]) * cone.transducer.max_range_m
    return np.concatenate([np.zeros((1, 2)), arc]) + cone.pose.position_m[:2]
