"""Reconstruction on several cores: pings do not depend on each other, only their fusion does."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

from usmap_ros.cone import EchoCone
from usmap_ros.errors import MalformedMessageError
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.parent import end_with_parent
from usmap_ros.pipeline import Pipeline
from usmap_ros.reconstruction.reconstructor import reconstruct_sounding
from usmap_ros.soundings import soundings
from usmap_ros.trace import EchoTrace

#: A trace and the topic that it came on; what became of it.
RecordedTrace = tuple[str, EchoTrace]
Outcome = tuple[str, int, EchoCone | MalformedMessageError]

#: Soundings that are handed to a worker at once, so that the handing over does not count.
BATCH = 16
#: Batches under way for each worker: enough to keep it busy, and memory flat.
BATCHES_AHEAD = 2


def available_cores() -> int:
    """Cores that this process may use."""
    # Not everywhere can a process be kept to some of the cores.
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class Reconstructors:
    """Processes that reconstruct traces, or this one alone.

    Parameters
    ----------
    pipeline : Pipeline
        Its reconstruction is what they do.
    executor : ProcessPoolExecutor, optional
        The processes; without it the caller's own does the work.
    processes : int
        How many there are.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        executor: ProcessPoolExecutor | None = None,
        processes: int = 1,
    ) -> None:
        self.processes = processes
        # Workers are sent the parameters: the pipeline itself has a map in it.
        self._parameters = pipeline.parameters.reconstruction
        self._noise = pipeline.noise
        self._executor = executor
        self._ahead = BATCHES_AHEAD * processes

    def cones(self, traces: Iterable[RecordedTrace]) -> Iterator[Outcome]:
        """Reconstruct traces, in their order; those of transducers that pinged at once, together.

        Yields
        ------
        (topic, stamp_ns, EchoCone or MalformedMessageError)
            The error says why a trace could not be reconstructed.
        """
        # What pings share is found here, where all of them pass.
        told = ((topic, self._noise.tell(trace)) for topic, trace in traces)
        if self._executor is None:
            for sounding in soundings(told):
                yield from _reconstruct_batch([sounding], self._parameters)
            return
        remaining = soundings(told)
        under_way: deque[Future[list[Outcome]]] = deque()
        while True:
            while len(under_way) < self._ahead and (batch := list(islice(remaining, BATCH))):
                under_way.append(self._executor.submit(_reconstruct_batch, batch, self._parameters))
            if not under_way:
                return
            yield from under_way.popleft().result()


@contextmanager
def reconstructors(pipeline: Pipeline, processes: int) -> Iterator[Reconstructors]:
    """Start processes that reconstruct as `pipeline` does, and end them.

    They are forked at once: enter this before anything starts a thread, such as a progress bar.
    One process means none but the caller's, and so does a caller that has threads already:
    what they hold at the fork, the child would wait for in vain.
    """
    if processes <= 1 or not _can_fork():
        yield Reconstructors(pipeline)
        return
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(
        processes, mp_context=context, initializer=_begin_worker, initargs=(os.getpid(),)
    ) as executor:
        for future in [executor.submit(available_cores) for _ in range(processes)]:
            future.result()
        try:
            yield Reconstructors(pipeline, executor, processes)
        finally:
            executor.shutdown(wait=True, cancel_futures=True)


def _begin_worker(parent: int) -> None:
    """Leave it to the process that forked this one to answer signals, and end with it."""
    # A terminal's Ctrl-C comes to all processes; one of them is to speak.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    end_with_parent(parent, signal.SIGKILL)


def _can_fork() -> bool:
    """Whether this process has one thread only, those that Python does not know of included."""
    threads = Path("/proc/self/task")
    return threads.is_dir() and len(list(threads.iterdir())) == 1


def _reconstruct_batch(
    batch: list[list[RecordedTrace]], parameters: ReconstructionParameters
) -> list[Outcome]:
    outcomes: list[Outcome] = []
    for sounding in batch:
        found = reconstruct_sounding([trace for _, trace in sounding], parameters)
        for (topic, trace), one in zip(sounding, found, strict=True):
            if one is not None:
                outcome = one if isinstance(one, MalformedMessageError) else one.cone
                outcomes.append((topic, trace.stamp_ns, outcome))
    return outcomes
