"""The picture of whatever it is."""

from matplotlib.figure import Figure

from usmap_ros.grids import OccupancyMap, TruthMap
from usmap_ros.mapping.candidates import candidate_cells
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.plotting.cone import cone_figure
from usmap_ros.plotting.map import map_figure
from usmap_ros.plotting.overview import overview_figure


def draw(
    what: OccupancyMap | EchoTrace | EchoCone,
    truth: TruthMap | None = None,
    parameters: PipelineParameters | None = None,
) -> Figure:
    """Draw a map; a ping, with what is found in it; or a cone, with where its echoes may be from.

    Parameters
    ----------
    what : OccupancyMap, EchoTrace or EchoCone
        What to draw.
    truth : TruthMap, optional
        What is really there, drawn as an outline.
    parameters : PipelineParameters, optional
        By which a trace is reconstructed, and the cells of its cone are weighed.

    Returns
    -------
    matplotlib.figure.Figure
        `usmap_ros.plotting.style.save_figure` writes it, and so does its own ``savefig``.
    """
    if isinstance(what, OccupancyMap):
        return map_figure(what, truth=truth)
    parameters = parameters or PipelineParameters()
    if isinstance(what, EchoCone):
        return cone_figure(what, candidate_cells(what, parameters.mapping), truth)
    # Here, because to draw a map needs no compiler.
    from usmap_ros.reconstruction.reconstructor import reconstruct

    found = reconstruct(what, parameters.reconstruction)
    return overview_figure(found, candidate_cells(found.cone, parameters.mapping), truth)
