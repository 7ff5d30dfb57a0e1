"""What one echo looks like in the baseband."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.numerics.arrays import FloatArray, Signal

#: Points at which the overlap of two echoes is tabulated, and further ones a cycle of its phase.
LAGS = 257
LAGS_PER_CYCLE = 16


@dataclass(frozen=True)
class Template:
    """The envelope that an echo has in the baseband, or its filtered form; a chirp's is complex."""

    #: The interval on which it is not zero.
    start_s: float
    duration_s: float
    #: Evaluated where `table` is None.
    pulse: Pulse
    #: (n,) array: values on an even grid over the interval.
    table: tuple[complex, ...] | None = None
    #: Frequency that the signal was mixed down by; None: the pulse's carrier.
    mixed_by_hz: float | None = None
    #: Standard deviation of the delay that sampling leaves open, however little noise there is.
    delay_jitter_s: float = 0.0
    #: The same of the amplitude, relative to it.
    amplitude_jitter: float = 0.0
    #: Norm of what the template leaves of an echo without noise, relative to the echo.
    misfit: float = 0.0

    def __hash__(self) -> int:
        # Worked out once: caches ask with every ping, and a table has hundreds of entries.
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.start_s, self.duration_s, self.pulse, self.table, self.mixed_by_hz))

    def __call__(self, time_s: FloatArray) -> Signal:
        """Envelope at times after the echo's delay."""
        if self.table is None:
            return self.pulse.envelope_above(self._centre_hz, time_s)
        values = np.asarray(self.table)
        grid = np.linspace(self.start_s, self.start_s + self.duration_s, len(values))
        envelope: Signal = np.interp(time_s, grid, values, left=0.0, right=0.0)
        return envelope

    def slope(self, time_s: FloatArray) -> Signal:
        """Derivative with respect to time, by central difference."""
        step_s = self.pulse.resolution_s * 1e-4
        slope: Signal = (self(time_s + step_s) - self(time_s - step_s)) / (2.0 * step_s)
        return slope

    def overlap(self, other: Template, delay_s: FloatArray) -> FloatArray:
        """Correlation with an echo that comes `delay_s` earlier, 1 of equal ones; its magnitude."""
        lags_s, correlation = _correlation(self, other)
        return np.interp(delay_s, lags_s, correlation, left=0.0, right=0.0)

    def point_count(self, least: int, per_cycle: int, per_point: int) -> int:
        """Points from its start to its end at which it is to be tabulated.

        Parameters
        ----------
        least, per_cycle : int
            Points at least, and further ones a cycle of its phase.
        per_point : int
            Points for each of its own, if it is a table.
        """
        if self.table is not None:
            return 1 + per_point * (len(self.table) - 1)
        return least + int(per_cycle * self.highest_hz * self.duration_s)

    @property
    def highest_hz(self) -> float:
        """Highest frequency by which its phase turns, either way."""
        return abs(self.pulse.carrier_hz - self._centre_hz) + 0.5 * abs(self.pulse.sweep_hz)

    @property
    def _centre_hz(self) -> float:
        return self.pulse.carrier_hz if self.mixed_by_hz is None else self.mixed_by_hz

    @property
    def is_smooth(self) -> bool:
        """Whether a delay can be told finer than a sample from it."""
        smooth = (PulseShape.HANN_BURST, PulseShape.CHIRP)
        is_drawn = self.table is not None or self.pulse.profile is not None
        return is_drawn or self.pulse.shape in smooth


@lru_cache(maxsize=64)
def _correlation(one: Template, other: Template) -> tuple[FloatArray, FloatArray]:
    """Lags of one behind the other, and their normalised correlation there."""
    longest_s = max(one.duration_s, other.duration_s)
    cycles = max(one.highest_hz, other.highest_hz) * longest_s
    step_s = float(longest_s / (LAGS + int(LAGS_PER_CYCLE * cycles) - 1))
    first, second = (
        template(template.start_s + np.arange(0.0, template.duration_s + 0.5 * step_s, step_s))
        for template in (one, other)
    )
    products = np.abs(np.correlate(second, first, mode="full"))
    correlation: FloatArray = products / (np.linalg.norm(first) * np.linalg.norm(second))
    lags = np.arange(len(correlation), dtype=np.float64) - (len(first) - 1)
    return step_s * lags, correlation
