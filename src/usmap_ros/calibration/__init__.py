"""What a recording itself says of its sensors and of the air: sound speed, floor, gain, offset.

The closed loop that Sanchez & Andersson (DSCC 2018-9140) leave for later: what the sensing
matrix takes for given is learnt from the recording that it is to explain.

`calibrate` does it in four steps: `echo_table` finds echoes, `floor` what trails them over the
floor, `objects` where what returned them stands, `fit` all quantities together, and `loudness`
the gain.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from usmap_ros.calibration.estimation import calibrate
    from usmap_ros.calibration.result import Calibration, Estimate
from usmap_ros.calibration.target import Target
from usmap_ros.lazy_names import offered

__all__ = ["Calibration", "Estimate", "Target", "calibrate"]

# Every recording's pulse is looked at, and few are calibrated.
__getattr__ = offered(
    __name__, {"estimation": ["calibrate"], "result": ["Calibration", "Estimate"]}
)
