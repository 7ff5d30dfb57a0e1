"""What mapping asks of a recording: its cones, what its receivers are, and its amplitudes."""

from __future__ import annotations

import heapq
import logging
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress

from usmap_ros.calibration.receiver_survey import SURVEYED, ReceiverSurvey
from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.message_types import ECHO_TRACE
from usmap_ros.pings.amplitude_scale import AmplitudeScales
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.runs.parallel import Reconstructors
from usmap_ros.runs.pipeline import Pipeline

logger = logging.getLogger(__name__)

#: Of a recording that is only looked into, every so many pings of a topic are reconstructed, and so
#: many at most: neighbours hear the same.
SURVEY_EVERY, SURVEY_MOST = 2, 50


def recorded_cones(bag: BagReader, workers: Reconstructors) -> Iterator[tuple[str, EchoCone]]:
    """Cones of a recording: reconstructed from traces, or else as recorded.

    Never both, because a recorded cone most often stems from a recorded trace, and evidence must
    not count twice.  Readings of robots that measure ranges only come in between.
    """
    cones = workers.cones(bag) if bag.trace_count else bag.cones()
    yield from heapq.merge(cones, bag.range_cones(), key=lambda entry: entry[1].stamp_ns)


def learn_reception(bag: BagReader, pipeline: Pipeline, workers: Reconstructors) -> None:
    """Let a pipeline know what a recording's receivers are, where they are not as stated."""
    survey = ReceiverSurvey(pipeline.parameters.reconstruction)
    waiting = {one.name for one in bag.topics if one.message_type == ECHO_TRACE and one.count}
    for topic, trace in bag.first_traces(SURVEYED):
        survey.add(topic, trace)
        if survey.is_full(topic) and survey.has_turned(topic):
            waiting.discard(topic)
            if not waiting:
                break
    judgings = {topic: survey.judging(topic) for topic in survey.topics()}
    for topic, found in workers.judgements(judgings).items():
        survey.take_up(topic, found)
    for topic, problem in survey.problems().items():
        logger.warning("%s: %s", topic, problem)
        pipeline.learn_reception(survey, topic)


class AmplitudeSurvey:
    """Judges the amplitudes of a recording by some of its pings, without mapping it.

    Parameters
    ----------
    pipeline : Pipeline
        Reconstructs their traces.
    """

    def __init__(self, pipeline: Pipeline) -> None:
        self._pipeline = pipeline
        self._pings: Counter[str] = Counter()
        self._scales = AmplitudeScales()

    def add(self, topic: str, ping: EchoTrace | EchoCone) -> None:
        """Take a ping into account, or leave it out if others before it were enough."""
        number = self._pings[topic]
        self._pings[topic] += 1
        if number % SURVEY_EVERY or number >= SURVEY_EVERY * SURVEY_MOST:
            return
        # What cannot be reconstructed says nothing of amplitudes.
        with suppress(MalformedMessageError):
            cone = self._pipeline.reconstruct(ping) if isinstance(ping, EchoTrace) else ping
            self._scales.add(topic, cone)

    def problems(self) -> dict[str, str]:
        """What is wrong, by topic."""
        return self._scales.problems()
