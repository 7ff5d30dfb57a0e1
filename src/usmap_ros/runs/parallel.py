"""Reconstruction on several cores: pings do not depend on each other, only their fusion does."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

from usmap_ros.bounds import LEAST_PROCESSES, PROCESSES_PER_CORE
from usmap_ros.calibration.learnt import LearntReception
from usmap_ros.calibration.receiver_survey import Judgement, Judging
from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.stretch import Skip, TraceStretch
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.soundings import soundings
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.processes.cores import available_cores
from usmap_ros.processes.threads import begun
from usmap_ros.processes.workers import HELPERS_PATIENCE, Beside, worker_processes
from usmap_ros.reconstruction.reconstructor import reconstruct_sounding
from usmap_ros.runs.pipeline import Pipeline

Result = TypeVar("Result")

#: A trace and the topic that it came on.
RecordedTrace = tuple[str, EchoTrace]

#: Traces that a worker gets at once, so that the handing over does not count.
BATCH = 32
#: A recording of fewer traces is mapped before processes for them would have begun.
WORTH_A_POOL = 300
#: Batches under way for each worker: enough to keep it busy, and memory flat.
BATCHES_AHEAD = 2


def most_processes() -> int:
    """As many as make sense: a few for each core, and some on a small machine, too."""
    return max(LEAST_PROCESSES, PROCESSES_PER_CORE * available_cores())


class Reconstructors:
    """Processes that reconstruct the traces of recordings, or this one alone.

    Parameters
    ----------
    pipeline : Pipeline
        Its reconstruction is what they do.
    executor : Executor, optional
        The processes; without it the caller's own does the work.
    processes : int
        How many there are.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        executor: Executor | None = None,
        processes: int = 1,
    ) -> None:
        self.processes = processes
        self._pipeline = pipeline
        self._executor = executor
        self._ahead = BATCHES_AHEAD * processes

    def cones(self, bag: BagReader) -> Iterator[tuple[str, EchoCone]]:
        """Yield topic and cone of a recording's traces, in their order.

        Those that cannot be used are accounted for in `bag.skipped`.
        """
        if self._executor is None:
            yield from cones_of(bag.traces(), self._pipeline, bag.skipped.add)
            return
        # Workers read for themselves: a trace takes as long to hand over as to read.
        remaining = bag.trace_stretch.cuts(BATCH)
        under_way: deque[Beside[StretchCones]] = deque()
        while True:
            while len(under_way) < self._ahead and (stretch := next(remaining, None)) is not None:
                under_way.append(self._begun(stretch))
            if not under_way:
                return
            found = under_way.popleft().result()
            for source, error in found.skipped:
                bag.skipped.add(source, error)
            yield from found.cones

    def judgements(self, judgings: Mapping[str, Judging]) -> dict[str, Judgement]:
        """What is found of receivers, by topic."""
        found = {
            topic: Beside(Judging.judgement, judging, executor=self._executor)
            for topic, judging in judgings.items()
        }
        return {topic: judged.result() for topic, judged in found.items()}

    def last(self, work: Callable[..., Result], *given: Any) -> Callable[[], Result]:
        """What work will give while this process goes on: waits for it when called.

        A process that does it leaves the cores to this one from then on; so nothing comes after.
        """
        if self._executor is None:
            return begun(partial(work, *given)).result
        beside = Beside(work, *given, executor=self._executor, patience=HELPERS_PATIENCE)
        return beside.result

    def _begun(self, stretch: TraceStretch) -> Beside[StretchCones]:
        # What pings share is found here, where all of them pass; the pipeline has a map in it.
        levels = self._pipeline.noise.levels(stretch.traces_without_noise())
        # An open file cannot be sent.
        stretch.messages.close()
        reception = self._pipeline.reception
        return Beside(stretch_cones, stretch, levels, reception, executor=self._executor)


@dataclass(frozen=True)
class StretchCones:
    """What became of the traces of a stretch."""

    #: Topic and cone of each trace, in their order.
    cones: list[tuple[str, EchoCone]]
    #: Source of each trace that could not be used, and why.
    skipped: list[tuple[str, MalformedMessageError]]


def stretch_cones(
    stretch: TraceStretch, levels: Sequence[float], reception: LearntReception
) -> StretchCones:
    """Read and reconstruct a stretch of a recording.

    Parameters
    ----------
    stretch : TraceStretch
        Where the traces lie that are to be reconstructed.
    levels : sequence of float
        Levels of noise, as `SharedNoise.levels` gives them, of those traces that state none.
    reception : LearntReception
        How each trace is reconstructed.
    """
    skipped: list[tuple[str, MalformedMessageError]] = []
    unstated = iter(levels)

    def with_noise(trace: EchoTrace) -> EchoTrace:
        return trace if trace.noise_std > 0.0 else replace(trace, noise_std=next(unstated))

    def skip(source: str, error: MalformedMessageError) -> None:
        skipped.append((source, error))

    try:
        traces = ((topic, with_noise(trace)) for topic, trace in stretch.traces(skip))
        return StretchCones(list(_cones(traces, reception, skip)), skipped)
    finally:
        stretch.messages.close()


def cones_of(
    traces: Iterable[RecordedTrace], pipeline: Pipeline, skip: Skip
) -> Iterator[tuple[str, EchoCone]]:
    """Reconstruct traces here, in their order; those of transducers that pinged at once, together.

    Parameters
    ----------
    traces : iterable of (str, EchoTrace)
        In the order of their stamps.
    pipeline : Pipeline
        Its reconstruction is what is done.
    skip : callable
        Told of traces that cannot be reconstructed.
    """
    stated = ((topic, pipeline.noise.with_noise(trace)) for topic, trace in traces)
    return _cones(stated, pipeline.reception, skip)


def _cones(
    traces: Iterable[RecordedTrace], reception: LearntReception, skip: Skip
) -> Iterator[tuple[str, EchoCone]]:
    for sounding in soundings(traces):
        pinged = [trace for _, trace in sounding]
        found = reconstruct_sounding(pinged, reception.of(pinged))
        for (topic, trace), one in zip(sounding, found, strict=True):
            if isinstance(one, MalformedMessageError):
                skip(f"{topic} at {trace.stamp_ns / 1e9:.6f} s", one)
            elif one is not None:
                yield topic, one.cone


@contextmanager
def reconstructors(pipeline: Pipeline, processes: int) -> Iterator[Reconstructors]:
    """Start processes that reconstruct as `pipeline` does, as `worker_processes` has them."""
    with worker_processes(processes) as executor:
        if executor is None:
            yield Reconstructors(pipeline)
        else:
            yield Reconstructors(pipeline, executor, processes)
