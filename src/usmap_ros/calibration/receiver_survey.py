"""Whether a receiver hears what its traces state, and nothing of itself; and what it is if not.

A person who buys a transducer does not know its pulse: its resonances round the burst off and ring
for longer than it lasts, and every echo seems to be many.  A recording's own loud echoes tell.
Nor does anybody know what its casing and its mount return to it: what is in every ping, tells.
And its converter counts in units of its own, and is noisier than its data sheet says.
"""

from __future__ import annotations

import math
from collections import defaultdict
from typing import NamedTuple

import numpy as np

from usmap_ros.calibration.own_sound import OwnSound, own_sound_of
from usmap_ros.calibration.pulse import MeasuredPulse, measure_pulse
from usmap_ros.calibration.ringing import Ringing, ringing_of
from usmap_ros.calibration.traces_apart import TracesApart
from usmap_ros.errors import MalformedMessageError
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.preparation.prepare import corrected, prepared
from usmap_ros.pings.preparation.units import unit_of
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.reconstruction.baseband import estimated_noise_std

#: Every so manyth trace of a topic is kept, so many at most, and of no more bytes than this.
_EVERY, _KEPT, _KEPT_BYTES = 2, 40, 4_000_000
#: Traces of a topic, the first ones, after which no more are wanted, though a robot still stands.
SURVEYED = 1000
#: Traces that tell the noise at the least, and how much louder than stated the quietest tenth of
#: them must be: where echoes leave no part silent, as in small rooms over a floor, they are 1.3.
LEAST_NOISY, UNDERSTATED = 10, 1.35
#: Greatest share of a learnt pulse's length by which two echoes must be apart: it rings for long,
#: and its beginning tells them.
_RINGING_EXCLUSION = 0.2


class Judgement(NamedTuple):
    """What was found of a receiver."""

    #: Its pulse, if that explains echoes much better than the stated one.
    pulse: MeasuredPulse | None = None
    #: What it hears of itself, and can be taken off; and what is left of that.
    own_sound: OwnSound | None = None
    ringing: Ringing | None = None

    def added_to(self, stated: ReconstructionParameters) -> ReconstructionParameters:
        """What is known with it."""
        known = _with_pulse(stated, self.pulse)
        ringing = known.ringing if self.ringing is None else self.ringing.parameters
        if self.own_sound is not None:
            ringing = self.own_sound.added_to(ringing)
        if ringing is known.ringing:
            return known
        return known.model_copy(update={"ringing": ringing})


class Judging(NamedTuple):
    """What a receiver is judged by, which takes a twentieth of a second."""

    #: Traces that tell its pulse, and those that tell its ringing; none where that is not asked.
    traces: list[EchoTrace]
    apart: list[EchoTrace]
    #: What is known of them beforehand.
    stated: ReconstructionParameters

    def judgement(self) -> Judgement:
        """What these say."""
        found = Judgement()
        if self.apart:
            found = Judgement(own_sound=own_sound_of(self.apart, self.stated))
        measured = measure_pulse(self.traces, found.added_to(self.stated)) if self.traces else None
        if measured is not None and measured.is_known:
            found = found._replace(pulse=measured)
        if self.apart:
            # Ringing is looked for in traces as they are, and left out of corrected ones.
            as_heard = [corrected(trace, self.stated.correction) for trace in self.apart]
            found = found._replace(ringing=ringing_of(as_heard, found.added_to(self.stated)))
        return found


class ReceiverSurvey:
    """Judges the stated pulse by some of the traces of each topic, and looks for ringing.

    Those of a robot that stands show the same in every ping; once it has moved, traces from places
    apart are judged.

    Parameters
    ----------
    parameters : ReconstructionParameters
        What is known of the traces; what is stated there is not judged.
    """

    def __init__(self, parameters: ReconstructionParameters) -> None:
        self._parameters = parameters
        ringing = parameters.ringing
        self._judges_pulse = parameters.pulse.kind == "stated"
        is_stated = any(ringing.amplitudes) or any(ringing.waveform)
        self._finds_ringing = ringing.learn and not is_stated
        self._finds_unit = parameters.correction.gain == 1.0
        self._judges_noise = parameters.correction.noise_factor == 1.0
        self._noise: defaultdict[str, list[float]] = defaultdict(list)
        self._units: dict[str, float] = {}
        self._seen: defaultdict[str, int] = defaultdict(int)
        self._first: defaultdict[str, list[EchoTrace]] = defaultdict(list)
        self._apart: defaultdict[str, TracesApart] = defaultdict(TracesApart)
        # When how many traces from places apart had been taken.
        self._learnt: dict[str, tuple[int, Judgement]] = {}

    def add(self, topic: str, trace: EchoTrace) -> None:
        """Take a trace into account, or leave it out if others before it are enough."""
        number = self._seen[topic]
        self._seen[topic] += 1
        if self._finds_unit and not self._units.get(topic):
            self._units[topic] = unit_of(trace)
        first = self._first[topic]
        most = min(_KEPT, _KEPT_BYTES // max(trace.samples.nbytes, 1))
        if self._judges_pulse and number % _EVERY == 0 and len(first) < most:
            first.append(trace)
        if self._judges_noise and number % _EVERY == 0 and len(self._noise[topic]) < _KEPT:
            self._noise[topic] += self._noise_of(trace)
        if self._wants_apart:
            self._apart[topic].add(trace)

    def _noise_of(self, trace: EchoTrace) -> list[float]:
        """Noise of a trace over what it states, if both can be told."""
        if not trace.noise_std > 0.0:
            return []
        try:
            factor = estimated_noise_std(prepared(trace, self._parameters)) / trace.noise_std
        except MalformedMessageError:
            # Its reconstruction will say why it cannot be used.
            return []
        return [factor * self._parameters.correction.gain] if math.isfinite(factor) else []

    def noise_factor(self, topic: str) -> float:
        """How many times as loud as stated the noise on a topic is, if it clearly is; or 1."""
        factors = self._noise[topic]
        if len(factors) < LEAST_NOISY or np.quantile(factors, 0.1) < UNDERSTATED:
            return 1.0
        return float(np.quantile(factors, 0.25))

    def is_in_other_units(self, topic: str) -> bool:
        """Whether traces of a topic are in other units than they should be."""
        return self._units.get(topic, 1.0) not in {0.0, 1.0}

    def is_full(self, topic: str) -> bool:
        """Whether traces of a topic are enough to judge its pulse."""
        return self._seen[topic] >= _EVERY * _KEPT

    def has_moved(self, topic: str) -> bool:
        """Whether they come from places enough to tell the pulse."""
        return not self._wants_apart or self._apart[topic].were_enough

    def has_turned(self, topic: str) -> bool:
        """Whether they tell what a transducer hears of itself, so that no more are wanted."""
        return self._apart[topic].have_turned if self._finds_ringing else self.has_moved(topic)

    @property
    def _wants_apart(self) -> bool:
        return self._judges_pulse or self._finds_ringing

    def topics(self) -> list[str]:
        """Topics whose traces were taken into account."""
        return sorted(self._seen)

    def transducers(self, topic: str) -> set[str]:
        """Frames of the transducers whose traces of a topic were taken into account."""
        return {trace.child_frame_id for trace in (*self._first[topic], *self._apart[topic].traces)}

    def known(self, topic: str) -> ReconstructionParameters | None:
        """Parameters for the transducers of one topic; None if nothing was learnt of them."""
        known = self._judged(topic).added_to(self._in_units(topic))
        return None if known is self._parameters else known

    def _in_units(self, topic: str) -> ReconstructionParameters:
        """What is known of the traces of a topic, with their noise and units of their samples."""
        found = {}
        if self.is_in_other_units(topic):
            found["gain"] = self._units[topic]
        if (factor := self.noise_factor(topic)) > 1.0:
            found["noise_factor"] = factor
        if not found:
            return self._parameters
        correction = self._parameters.correction.model_copy(update=found)
        return self._parameters.model_copy(update={"correction": correction})

    def _judged(self, topic: str) -> Judgement:
        """What was found last, or now if there are traces from more places since."""
        judged, found = self._learnt.get(topic, (-1, Judgement()))
        if judged < self._apart[topic].taken:
            found = self.judging(topic).judgement()
            self.take_up(topic, found)
        return found

    def judging(self, topic: str) -> Judging:
        """What there is to be judged of a topic."""
        apart = list(self._apart[topic].traces)
        traces = apart if self.has_moved(topic) else list(self._first[topic])
        return Judging(
            traces if self._judges_pulse else [],
            apart if self._finds_ringing else [],
            self._in_units(topic),
        )

    def take_up(self, topic: str, found: Judgement) -> None:
        """Take what was found for what is known of a topic, until it is judged again."""
        self._learnt[topic] = self._apart[topic].taken, found

    def problems(self) -> dict[str, str]:
        """What is wrong, by topic, in one line; topics of which nothing is are left out."""
        found = {topic: self.problem(topic) for topic in self.topics()}
        return {topic: problem for topic, problem in found.items() if problem}

    def problem(self, topic: str) -> str:
        """What is wrong with the receiver of one topic; empty if nothing is."""
        measured, own_sound, ringing = self._judged(topic)
        said = []
        if self.is_in_other_units(topic):
            said.append(_said_of_unit(self._units[topic]))
        if (factor := self.noise_factor(topic)) > 1.0:
            said.append(
                f"its noise is {factor:.1f} times as loud as stated, and taken for what it is"
                " (reconstruction.correction.noise_factor)"
            )
        if measured is not None:
            said.append(_said_of_pulse(measured, is_learnt=self._parameters.pulse.learn))
        if own_sound is not None:
            said.append(
                f"it hears itself in every ping, until {1e3 * own_sound.end_s:.1f} ms, which is"
                " taken off its traces (reconstruction.ringing.learn)"
            )
        if ringing is not None:
            where = ", ".join(f"{range_m:.2f}" for range_m in ringing.ranges_m)
            said.append(
                f"it hears itself in every ping, {where} m away, and no such echo is taken for an"
                " object (reconstruction.ringing.learn)"
            )
        return "; ".join(said)


def _said_of_unit(unit: float) -> str:
    decibels = 20.0 * math.log10(unit)
    return (
        f"its samples are some {abs(decibels):.0f} dB {'larger' if unit > 1.0 else 'smaller'} than"
        f" echoes are, such as a converter's counts, and are divided by {unit:g}"
        " (reconstruction.correction.gain)"
    )


def _said_of_pulse(measured: MeasuredPulse, *, is_learnt: bool) -> str:
    if is_learnt:
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


def _with_pulse(
    parameters: ReconstructionParameters, measured: MeasuredPulse | None
) -> ReconstructionParameters:
    """Parameters with a pulse that was learnt, where there is one and it is wanted."""
    if measured is None or not parameters.pulse.learn:
        return parameters
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
