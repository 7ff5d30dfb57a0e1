"""The transducer: pulse, beam and the ranges it is meant for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse
from usmap_ros.errors import MalformedMessageError

#: Longest range that is believed.
MAX_RANGE_M = 1000.0


@dataclass(frozen=True)
class Transducer:
    """Hardware of one ultrasonic transducer (``usmap_msgs/Transducer``).

    Parameters
    ----------
    pulse : Pulse
        What it emits.
    beam : BeamPattern
        Two-way amplitude gain off axis.
    min_range_m, max_range_m : float
        Range limits of what it reports.
    """

    pulse: Pulse
    beam: BeamPattern
    min_range_m: float
    max_range_m: float

    def validate(self) -> None:
        """Raise `MalformedMessageError` unless such a transducer can exist."""
        self.pulse.validate()
        self.beam.validate()
        if not (np.isfinite(self.min_range_m) and self.min_range_m >= 0.0):
            raise MalformedMessageError(
                "transducer.min_range", f"is {self.min_range_m:g} m, must be 0 or more"
            )
        if not (np.isfinite(self.max_range_m) and self.max_range_m > self.min_range_m):
            raise MalformedMessageError(
                "transducer.max_range",
                f"is {self.max_range_m:g} m, must be above min_range ({self.min_range_m:g} m)",
            )
        # Memory for a ping grows with the range; air lets nothing be heard from this far.
        if self.max_range_m > MAX_RANGE_M:
            raise MalformedMessageError(
                "transducer.max_range",
                f"is {self.max_range_m:g} m, must be at most {MAX_RANGE_M:g} m",
            )
