"""Every parameter, declared once: default, meaning, unit and bounds.

YAML files, options of the command line, ROS parameters with their descriptors, the shipped
example files and the reference page are derived from these declarations.

`fields` says how a parameter is declared, `pipeline` has those of reconstruction and mapping,
`reception` those of what traces lack, `poses` those of where robots are, `nodes` those of the live
nodes.  Scenario files are declared in the same way, in `usmap_ros.simulation`.
"""

from usmap_ros.parameters.fields import ParameterGroup, quantity
from usmap_ros.parameters.pipeline import (
    MappingParameters,
    PipelineParameters,
    ReconstructionParameters,
)
from usmap_ros.parameters.poses import PoseParameters
from usmap_ros.parameters.reception import CorrectionParameters, PulseParameters, RingingParameters

__all__ = [
    "CorrectionParameters",
    "MappingParameters",
    "ParameterGroup",
    "PipelineParameters",
    "PoseParameters",
    "PulseParameters",
    "ReconstructionParameters",
    "RingingParameters",
    "quantity",
]
