"""Pictures of traces, cones and maps.

Figures are made with matplotlib's object-oriented interface: no display, no global state.  Every
function returns a `matplotlib.figure.Figure`, and `save_figure` writes it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from usmap_ros.lazy_names import offered

if TYPE_CHECKING:
    from usmap_ros.plotting.cone import cone_figure
    from usmap_ros.plotting.map import map_figure
    from usmap_ros.plotting.overview import overview_figure
    from usmap_ros.plotting.picture import draw
    from usmap_ros.plotting.style import save_figure
    from usmap_ros.plotting.trace import trace_figure

__all__ = ["cone_figure", "draw", "map_figure", "overview_figure", "save_figure", "trace_figure"]

__getattr__ = offered(
    __name__,
    {
        "cone": ["cone_figure"],
        "map": ["map_figure"],
        "overview": ["overview_figure"],
        "picture": ["draw"],
        "style": ["save_figure"],
        "trace": ["trace_figure"],
    },
)
