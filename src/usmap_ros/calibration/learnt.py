"""How traces are reconstructed of transducers of which something was learnt from their echoes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from usmap_ros.calibration.receiver_survey import ReceiverSurvey
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.trace import EchoTrace


@dataclass(frozen=True)
class LearntReception:
    """Parameters of reconstruction, with those of transducers of which something was learnt."""

    #: Where nothing was learnt, and where several pulses are in the air.
    stated: ReconstructionParameters
    #: By the frames of transducers.
    learnt: Mapping[str, ReconstructionParameters] = field(default_factory=dict)

    def of(self, traces: Sequence[EchoTrace]) -> ReconstructionParameters:
        """Parameters for the traces of one ping: of a transducer, or of several at once."""
        if len(traces) > 1:
            return self.stated
        return self.learnt.get(traces[0].child_frame_id, self.stated)

    def with_those_of(self, survey: ReceiverSurvey, topic: str) -> LearntReception:
        """The same and what a survey has learnt of the transducers on a topic, if anything."""
        known = survey.known(topic)
        if known is None:
            return self
        return LearntReception(
            self.stated, {**self.learnt, **dict.fromkeys(survey.transducers(topic), known)}
        )
