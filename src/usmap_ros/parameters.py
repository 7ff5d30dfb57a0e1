"""Every parameter of reconstruction and mapping, declared once.

YAML files, ROS parameter descriptors and the reference page are derived from these models.
"""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


def quantity(default: Any, description: str, unit: str = "", **bounds: Any) -> Any:
    """Field with a default, a description, a unit and bounds (``ge``, ``gt``, ``le``, ``lt``).

    `unit` is an SI unit or "" for a pure number; it is kept in the field's JSON schema.
    """
    return Field(default, description=description, json_schema_extra={"unit": unit}, **bounds)


class ParameterGroup(BaseModel):
    """Base of all parameter groups: immutable, and an unknown key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


class ReconstructionParameters(ParameterGroup):
    """How echoes are recovered from one trace."""


class MappingParameters(ParameterGroup):
    """How cones become a map."""

    resolution_m: float = quantity(0.05, "Side of a map cell.", "m", ge=0.005, le=2.0)


class PipelineParameters(ParameterGroup):
    """Everything between an echo trace and a map."""

    reconstruction: ReconstructionParameters = ReconstructionParameters()
    mapping: MappingParameters = MappingParameters()
