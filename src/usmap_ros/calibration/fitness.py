"""Whether the pulse that traces state is the one that they hold, and which one it is if not.

A person who buys a transducer does not know its pulse: its resonances round the burst off and ring
for longer than it lasts, and every echo seems to be many.  A recording's own loud echoes tell.
"""

from __future__ import annotations

from collections import defaultdict

from usmap_ros.calibration.pulse import MeasuredPulse, measure_pulse
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.trace import EchoTrace

#: Every so manyth trace of a topic is kept, so many at most, and of no more bytes than this.
_EVERY, _KEPT, _KEPT_BYTES = 2, 40, 4_000_000
#: Traces of a topic, the first ones, after which no more are wanted.
PULSES_OF = _EVERY * _KEPT


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
        self._learnt: dict[str, MeasuredPulse | None] = {}

    def add(self, topic: str, trace: EchoTrace) -> None:
        """Take a trace into account, or leave it out if others before it are enough."""
        number = self._seen[topic]
        self._seen[topic] += 1
        is_wanted = self._parameters.pulse.kind == "stated" and number % _EVERY == 0
        kept = self._traces[topic]
        has_room = len(kept) < min(_KEPT, _KEPT_BYTES // max(trace.samples.nbytes, 1))
        if is_wanted and has_room:
            kept.append(trace)

    def is_full(self, topic: str) -> bool:
        """Whether no more traces of a topic are wanted."""
        return len(self._traces[topic]) >= _KEPT

    def problems(self) -> dict[str, str]:
        """What is wrong, by topic, in one line; topics of which nothing is are left out."""
        found = {topic: self.problem(topic) for topic in sorted(self._traces)}
        return {topic: problem for topic, problem in found.items() if problem}

    def learnt(self, topic: str) -> MeasuredPulse | None:
        """The pulse of one topic, if it explains its echoes much better than the stated one."""
        if topic not in self._learnt:
            measured = measure_pulse(self._traces[topic], self._parameters)
            is_known = measured is not None and measured.is_known
            self._learnt[topic] = measured if is_known else None
        return self._learnt[topic]

    def transducers(self, topic: str) -> set[str]:
        """Frames of the transducers whose traces of a topic were taken into account."""
        return {trace.child_frame_id for trace in self._traces[topic]}

    def problem(self, topic: str) -> str:
        """What is wrong with the pulse of one topic; empty if nothing is."""
        measured = self.learnt(topic)
        if measured is None:
            return ""
        if self._parameters.pulse.learn:
            return (
                f"the stated pulse leaves {measured.stated_residual:.2f} of an echo; one learnt"
                f" from {measured.echoes} echoes leaves {measured.residual:.2f} and is used instead"
                " (reconstruction.pulse.learn)"
            )
        return (
            f"the stated pulse leaves {measured.stated_residual:.2f} of an echo, a measured"
            f" one {measured.residual:.2f}: echoes are found that are none; usmap calibrate"
            " measures the pulse (reconstruction.pulse)"
        )
