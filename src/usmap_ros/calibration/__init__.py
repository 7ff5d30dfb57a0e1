"""What a recording itself says of its sensors and of the air: sound speed, floor, gain, offset.

The closed loop that Sanchez & Andersson (DSCC 2018-9140) leave for later: what the sensing
matrix takes for given is learnt from the recording that it is to explain.

`calibrate` does it in four steps: `echo_table` finds echoes, `floor` what trails them over the
floor, `objects` where what returned them stands, `fit` all quantities together, and `loudness`
the gain.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from usmap_ros.calibration.estimation import calibrate
    from usmap_ros.calibration.result import Calibration, Estimate
from usmap_ros.calibration.target import Target

__all__ = ["Calibration", "Estimate", "Target", "calibrate"]

_MODULES = dict.fromkeys(("Calibration", "Estimate", "Target"), "result")
_MODULES["calibrate"] = "estimation"


def __getattr__(name: str) -> object:
    """Import what is asked for: every recording's pulse is looked at, and few are calibrated."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
