"""What reconstruction makes of a trace; here, because who draws it needs no compiler."""

from dataclasses import dataclass

from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.numerics.arrays import FloatArray, Signal
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace


@dataclass(frozen=True)
class Reconstruction:
    """A trace explained by echoes."""

    #: What was explained: with what is known to be off in it set right.
    trace: EchoTrace
    #: What fusion is told.
    cone: EchoCone
    #: (samples,) arrays: the signal that was explained, and what the echoes leave of it; complex or
    #: real.
    received: Signal
    residual: Signal
    #: When its samples were taken.
    sampling: Sampling
    #: How long after its delay an echo peaks.
    peak_s: float
    #: Standard deviation of the noise of `received`, of the complex value where it is complex.
    noise_std: float

    @property
    def delays_s(self) -> FloatArray:
        """Delay of the echo that peaks at each sample."""
        return self.sampling.times_s - self.peak_s
