"""What the parameters of several nodes have in common."""

from __future__ import annotations

import re
from typing import Any, ClassVar

from usmap_ros.parameters.fields import ParameterGroup, quantity


class NodeParameters(ParameterGroup):
    """What all nodes have."""

    #: Parameters, or groups of them, that cannot be changed while the node runs.
    fixed: ClassVar[frozenset[str]] = frozenset({"diagnostics_period_s"})

    diagnostics_period_s: float = quantity(
        1.0, "Time from one diagnostic message to the next.", "s", ge=0.05, le=60.0
    )


def latency_limit() -> Any:
    """Declare the limit that nodes have through which messages go."""
    return quantity(
        1.0,
        "Latency beyond which the node warns in /diagnostics, if half of the messages take longer.",
        "s",
        gt=0.0,
        le=3600.0,
    )


def check_pattern(pattern: str) -> str:
    """Refuse what is no regular expression; a pydantic validator.

    Raises
    ------
    ValueError
        With the reason.
    """
    try:
        re.compile(pattern)
    except re.error as error:
        raise ValueError(f"is no regular expression: {error}") from error
    return pattern
