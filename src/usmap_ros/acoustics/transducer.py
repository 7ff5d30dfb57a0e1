"""The transducer: pulse, beam and the ranges it is meant for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from usmap_ros import bounds
from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse
from usmap_ros.errors import MalformedMessageError


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

    @property
    def stated(self) -> Transducer:
        """The transducer as a message states it."""
        return self if self.pulse.profile is None else replace(self, pulse=self.pulse.driven)

    def validate(self) -> None:
        """Raise `MalformedMessageError` unless such a transducer can exist."""
        # Once for all pings that share it.
        assert self._is_valid

    @cached_property
    def _is_valid(self) -> bool:
        """True; raises an error if it is not."""
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
        bounds.check("transducer.min_range", self.min_range_m, bounds.MIN_RANGE)
        bounds.check("transducer.max_range", self.max_range_m, bounds.MAX_RANGE)
        return True

    def validate_loss(self, attenuation_db_m: float) -> None:
        """Raise `MalformedMessageError` if air swallows all sound on the way to `max_range_m`."""
        bounds.check("attenuation", attenuation_db_m, bounds.ATTENUATION)
        loss_db = 2.0 * attenuation_db_m * self.max_range_m
        if loss_db > bounds.MAX_LOSS_DB:
            raise MalformedMessageError(
                "attenuation",
                f"of {attenuation_db_m:g} dB/m takes {loss_db:.3g} dB to max_range"
                f" ({self.max_range_m:g} m) and back, must be at most {bounds.MAX_LOSS_DB:g}",
            )
