"""When a signal is sampled, and which of its samples a pulse falls on."""

from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray


@dataclass(frozen=True)
class Sampling:
    """When the samples (or I/Q pairs) of a signal are taken."""

    #: Samples, or pairs of I and Q, per second.
    sample_rate_hz: float
    #: From the start of emission to the first one.
    start_delay_s: float
    #: How many they are.
    sample_count: int

    @property
    def times_s(self) -> FloatArray:
        """When each sample is taken, after the start of emission."""
        return self.start_delay_s + np.arange(self.sample_count) / self.sample_rate_hz

    @property
    def end_s(self) -> float:
        """One sample's time after the last one."""
        return self.start_delay_s + self.sample_count / self.sample_rate_hz

    def touched(self, delays_s: FloatArray, duration_s: float) -> tuple[IndexArray, FloatArray]:
        """Samples that fall on pulses of `duration_s` which arrive after `delays_s`.

        Returns
        -------
        samples : (..., taps) integer array
            Consecutive ones for each delay, whether or not they are among those taken.
        ages_s : (..., taps) array
            How long after the start of its pulse each is taken.
        """
        rate_hz, start_s = self.sample_rate_hz, self.start_delay_s
        first = np.ceil((delays_s - start_s) * rate_hz).astype(np.intp)
        samples = first[..., np.newaxis] + np.arange(int(np.ceil(duration_s * rate_hz)) + 1)
        return samples, samples / rate_hz + start_s - delays_s[..., np.newaxis]

    def takes(self, samples: IndexArray) -> BoolArray:
        """Whether samples of these numbers are among those taken."""
        taken: BoolArray = (samples >= 0) & (samples < self.sample_count)
        return taken
