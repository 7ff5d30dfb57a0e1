"""Multi-robot occupancy mapping from in-air ultrasound.

Imports go one way: numerics → acoustics → pings → io → reconstruction → runs → live → nodes → cli.
``simulation``, ``mapping`` and ``evaluation`` stand beside reconstruction.

What programs need most can be had from here; docs/python.md shows how.  Nothing is imported
before it is asked for, and nothing of it needs ROS.

Examples
--------
>>> import usmap_ros
>>> pipeline = usmap_ros.Pipeline()
>>> pole = usmap_ros.hear([(1.5, 0.2)], pose=usmap_ros.Pose.planar(0.0, 0.0, 0.0))
>>> cone = pipeline.process(pole)
>>> len(cone.ranges_m)
1
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from usmap_ros.lazy_names import offered

if TYPE_CHECKING:
    from usmap_ros.acoustics.beam import BeamPattern
    from usmap_ros.acoustics.propagation import Channel
    from usmap_ros.acoustics.pulse import Pulse, PulseShape
    from usmap_ros.acoustics.transducer import Transducer
    from usmap_ros.errors import UsmapError
    from usmap_ros.evaluation.scoring import score
    from usmap_ros.grids import OccupancyMap, TruthMap
    from usmap_ros.io.bags import read_bag, write_bag
    from usmap_ros.io.map_files import load_map, load_truth, save_map
    from usmap_ros.numerics.geometry import Pose
    from usmap_ros.parameters import PipelineParameters
    from usmap_ros.pings.cone import EchoCone
    from usmap_ros.pings.fields_of_view import PingViews
    from usmap_ros.pings.trace import EchoTrace, Encoding
    from usmap_ros.plotting.picture import draw
    from usmap_ros.runs.pipeline import Pipeline
    from usmap_ros.runs.trial import try_scenario
    from usmap_ros.simulation import Scenario, hear, simulate

__version__ = "0.1.0"

__all__ = [
    "BeamPattern",
    "Channel",
    "EchoCone",
    "EchoTrace",
    "Encoding",
    "OccupancyMap",
    "PingViews",
    "Pipeline",
    "PipelineParameters",
    "Pose",
    "Pulse",
    "PulseShape",
    "Scenario",
    "Transducer",
    "TruthMap",
    "UsmapError",
    "draw",
    "hear",
    "load_map",
    "load_truth",
    "read_bag",
    "save_map",
    "score",
    "simulate",
    "try_scenario",
    "write_bag",
]

__getattr__ = offered(
    __name__,
    {
        "acoustics.beam": ["BeamPattern"],
        "acoustics.propagation": ["Channel"],
        "acoustics.pulse": ["Pulse", "PulseShape"],
        "acoustics.transducer": ["Transducer"],
        "pings.cone": ["EchoCone"],
        "pings.fields_of_view": ["PingViews"],
        "errors": ["UsmapError"],
        "numerics.geometry": ["Pose"],
        "grids": ["OccupancyMap", "TruthMap"],
        "io.bags": ["read_bag", "write_bag"],
        "io.map_files": ["load_map", "load_truth", "save_map"],
        "evaluation.scoring": ["score"],
        "parameters": ["PipelineParameters"],
        "runs.pipeline": ["Pipeline"],
        "plotting.picture": ["draw"],
        "simulation": ["Scenario", "hear", "simulate"],
        "pings.trace": ["EchoTrace", "Encoding"],
        "runs.trial": ["try_scenario"],
    },
)


def __dir__() -> list[str]:
    """Names that can be had, imported or not."""
    return sorted({*globals(), *__all__})
