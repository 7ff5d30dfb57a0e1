"""Picture of one ping of a recording: trace above, cone below or beside."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from usmap_ros.grids import TruthMap
from usmap_ros.mapping.candidates import CandidateCells
from usmap_ros.plotting import style
from usmap_ros.plotting.cone import LIKELIHOOD_LABEL, draw_cone
from usmap_ros.plotting.trace import draw_trace

if TYPE_CHECKING:
    from usmap_ros.reconstruction.explained import Reconstruction


def overview_figure(
    reconstruction: Reconstruction, candidates: CandidateCells, truth: TruthMap | None = None
) -> Figure:
    """Draw a ping's trace, its residual, and the cone that came of it, side by side.

    Parameters
    ----------
    reconstruction : Reconstruction
        What reconstruction made of it.
    candidates : CandidateCells
        Cells that may have returned its echoes.
    truth : TruthMap, optional
        What is really there.
    """
    with style.styled():
        figure = style.new_figure(12.5, 5.0)
        panels: Any = figure.subfigures(1, 2, width_ratios=[1.25, 1.0])
        left, right = panels
        upper, lower = left.subplots(2, 1, sharex=True, height_ratios=[3, 1.3])
        draw_trace(upper, lower, reconstruction)
        axes = right.subplots()
        image = draw_cone(axes, reconstruction.cone, candidates, truth)
        right.colorbar(image, ax=axes, shrink=0.8, label=LIKELIHOOD_LABEL)
    return figure
