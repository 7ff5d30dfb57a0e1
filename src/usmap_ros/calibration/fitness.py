"""Whether the pulse that traces state is the one that they hold, without calibrating anything."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator

from usmap_ros.calibration.pulse import measure_pulse
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.trace import EchoTrace

#: Every so manyth trace of a topic is kept, and so many at most.
_EVERY, _KEPT = 2, 40


class PulseSurvey:
    """Judges the stated pulse by some of the traces of each topic.

    Parameters
    ----------
    parameters : ReconstructionParameters
        What is known of the traces; where that is the pulse, nothing is judged.
    """

    def __init__(self, parameters: ReconstructionParameters) -> None:
        self._parameters = parameters
        self._seen: defaultdict[str, int] = defaultdict(int)
        self._traces: defaultdict[str, list[EchoTrace]] = defaultdict(list)

    def add(self, topic: str, trace: EchoTrace) -> None:
        """Take a trace into account, or leave it out if others before it are enough."""
        number = self._seen[topic]
        self._seen[topic] += 1
        is_wanted = self._parameters.pulse.kind == "stated" and number % _EVERY == 0
        if is_wanted and len(self._traces[topic]) < _KEPT:
            self._traces[topic].append(trace)

    def watch(self, traces: Iterable[tuple[str, EchoTrace]]) -> Iterator[tuple[str, EchoTrace]]:
        """Pass traces on, and take them into account."""
        for topic, trace in traces:
            self.add(topic, trace)
            yield topic, trace

    def problems(self) -> dict[str, str]:
        """What is wrong, by topic, in one line; topics of which nothing is are left out."""
        found = {}
        for topic, traces in sorted(self._traces.items()):
            measured = measure_pulse(traces, self._parameters)
            if measured is not None and measured.is_told:
                found[topic] = (
                    f"the stated pulse leaves {measured.stated_residual:.2f} of an echo, a measured"
                    f" one {measured.residual:.2f}: echoes are found that are none; usmap calibrate"
                    " measures the pulse (reconstruction.pulse)"
                )
        return found
