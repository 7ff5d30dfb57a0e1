"""How traces are reconstructed of transducers whose pulse was learnt from their own echoes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from usmap_ros.calibration.fitness import PulseSurvey
from usmap_ros.calibration.pulse import MeasuredPulse
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.trace import EchoTrace

#: Greatest share of a learnt pulse's length by which two echoes must be apart: it rings for long,
#: and its beginning tells them.
_RINGING_EXCLUSION = 0.2


@dataclass(frozen=True)
class LearntPulses:
    """Parameters of reconstruction, with those of transducers whose pulse was learnt.

    Parameters
    ----------
    stated : ReconstructionParameters
        Where nothing was learnt, and where several pulses are in the air.
    learnt : mapping of str to ReconstructionParameters
        By the frames of transducers.
    """

    stated: ReconstructionParameters
    learnt: Mapping[str, ReconstructionParameters] = field(default_factory=dict)

    def of(self, traces: Sequence[EchoTrace]) -> ReconstructionParameters:
        """Parameters for the traces of one ping: of a transducer, or of several at once."""
        if len(traces) > 1:
            return self.stated
        return self.learnt.get(traces[0].child_frame_id, self.stated)

    def with_those_of(self, survey: PulseSurvey, topic: str) -> LearntPulses:
        """The same and what a survey has learnt of the transducers on a topic, if anything."""
        measured = survey.learnt(topic)
        if measured is None or not self.stated.pulse.learn:
            return self
        known = _with_pulse(self.stated, measured)
        return LearntPulses(
            self.stated, {**self.learnt, **dict.fromkeys(survey.transducers(topic), known)}
        )


def _with_pulse(
    parameters: ReconstructionParameters, measured: MeasuredPulse
) -> ReconstructionParameters:
    exclusion = parameters.exclusion
    if "exclusion" not in parameters.model_fields_set:
        exclusion = min(exclusion, _RINGING_EXCLUSION)
    return parameters.model_copy(
        update={
            "pulse": measured.parameters,
            "model_error": max(parameters.model_error, measured.own_error),
            "exclusion": exclusion,
        }
    )
