"""One level of noise for all pings of a transducer that states none.

A single trace tells its noise from its quietest part, which a few echoes more or less move about.
Pings of one receiver have the same noise.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from usmap_ros.errors import MalformedMessageError
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.preparation.prepare import prepared
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.reconstruction.baseband import estimated_noise_std

#: Every ping is listened to until so many were, then every so manyth; the latest ones count.
_FIRST, _EVERY, _LATEST = 20, 5, 60


@dataclass
class _Level:
    """What is known of one transducer's noise."""

    pings: int = 0
    estimates: deque[float] = field(default_factory=lambda: deque(maxlen=_LATEST))


class SharedNoise:
    """Tells traces that state no noise what their transducer's is, by the pings so far.

    Parameters
    ----------
    parameters : ReconstructionParameters
        What is off in the traces.
    """

    def __init__(self, parameters: ReconstructionParameters) -> None:
        self._parameters = parameters
        self._levels: dict[str, _Level] = {}

    def with_noise(self, trace: EchoTrace) -> EchoTrace:
        """Return `trace` with a level of noise; as it is if it states one, or tells none."""
        if trace.noise_std > 0.0:
            return trace
        level = self._levels.setdefault(trace.child_frame_id, _Level())
        if level.pings < _FIRST or level.pings % _EVERY == 0:
            self._listen(level, trace)
        level.pings += 1
        if not level.estimates:
            return trace
        return replace(trace, noise_std=float(np.median(level.estimates)))

    def levels(self, traces: Iterable[EchoTrace]) -> list[float]:
        """Levels that `with_noise` gives traces; 0 for those that tell none."""
        return [self.with_noise(trace).noise_std for trace in traces]

    def _listen(self, level: _Level, trace: EchoTrace) -> None:
        try:
            heard = prepared(trace, self._parameters)
            estimate = estimated_noise_std(heard) * self._parameters.correction.gain
        except MalformedMessageError:
            # Its reconstruction will say why it cannot be used.
            return
        if np.isfinite(estimate) and estimate > 0.0:
            level.estimates.append(estimate)
