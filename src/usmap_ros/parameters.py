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

    sparsity: int = quantity(
        32, "Most echoes that are looked for in one ping (k of CoSaMP).", ge=1, le=1000
    )
    non_negative: bool = quantity(
        True, "Fit real, not negative coefficients where the signal has no carrier phase."
    )
    false_alarms_per_ping: float = quantity(
        0.01, "Noise peaks taken for an echo, expected in one ping.", gt=0.0, lt=1.0
    )
    model_error: float = quantity(
        0.02,
        "Amplitude near an echo, relative to it, that may be due to an imperfect pulse model.",
        ge=0.0,
        lt=1.0,
    )
    oversampling: int = quantity(4, "Delays on the search grid per baseband sample.", ge=1, le=64)
    exclusion: float = quantity(
        0.35, "Least delay between two echoes, in pulse durations.", gt=0.0, le=2.0
    )
    refinements: int = quantity(
        4, "Rounds of moving delays off the grid and searching again.", ge=0, le=50
    )
    max_iterations: int = quantity(20, "CoSaMP iterations in one round.", ge=1, le=1000)
    limit_step_m: float = quantity(
        0.025, "Range bins in which the detection limit is reported.", "m", ge=0.001, le=1.0
    )


class MappingParameters(ParameterGroup):
    """How cones become a map."""

    resolution_m: float = quantity(0.05, "Side of a map cell.", "m", ge=0.005, le=2.0)


class PipelineParameters(ParameterGroup):
    """Everything between an echo trace and a map."""

    reconstruction: ReconstructionParameters = ReconstructionParameters()
    mapping: MappingParameters = MappingParameters()
