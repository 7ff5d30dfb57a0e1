"""Reconstruction on several cores: pings do not depend on each other, only their fusion does."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    as_completed,
)
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

from usmap_ros.cone import EchoCone
from usmap_ros.errors import FileError, MalformedMessageError, UsmapError
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

#: Address of a cluster that is to be started here.
LOCAL = "local"
#: How often Dask tries again what failed because of the worker, not of the work.
RETRIES = 3
#: Dask's error for work at which one worker after the other died.
_KILLED = "KilledWorker"

_Result = TypeVar("_Result")


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
    with worker_processes(processes) as executor:
        if executor is None:
            yield Reconstructors(pipeline)
        else:
            yield Reconstructors(pipeline, executor, processes)


@contextmanager
def worker_processes(processes: int) -> Iterator[Executor | None]:
    """Start processes that work for this one, and end them; None where it has to work alone.

    See `reconstructors` for when that is.
    """
    if processes <= 1 or not _can_fork():
        yield None
        return
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(
        processes, mp_context=context, initializer=_begin_worker, initargs=(os.getpid(),)
    ) as executor:
        for future in [executor.submit(available_cores) for _ in range(processes)]:
            future.result()
        try:
            yield executor
        finally:
            executor.shutdown(wait=True, cancel_futures=True)


@contextmanager
def cluster(scheduler: str, workers: int) -> Iterator[Executor]:
    """Workers of a Dask cluster, which take over the work of those that die.

    Parameters
    ----------
    scheduler : str
        Address of its scheduler, such as ``tcp://10.0.0.1:8786``; "local" starts a cluster.
    workers : int
        How many processes a local one has.

    Raises
    ------
    UsmapError
        If Dask is not installed, or there is no scheduler at that address.
    """
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise UsmapError(
            "a scheduler needs Dask, which 'pip install usmap_ros[dask]' installs"
        ) from error
    with ExitStack() as stack:
        place: Any = scheduler
        if scheduler == LOCAL:
            place = stack.enter_context(
                LocalCluster(
                    n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0"
                )
            )
        try:
            client = stack.enter_context(Client(place))
        except (OSError, ValueError) as error:
            raise UsmapError(f"{scheduler}: no Dask scheduler answers: {error}") from error
        # Each piece of work is new: results of an earlier run need not be those of this one.
        yield stack.enter_context(client.get_executor(pure=False, retries=RETRIES))


@dataclass(frozen=True)
class Failure:
    """Why a piece of work was not done."""

    cause: str


def results(
    executor: Executor | None, function: Callable[..., _Result], work: Sequence[tuple[Any, ...]]
) -> Iterator[tuple[int, _Result | Failure]]:
    """Have pieces of work done, by this process if there is no executor.

    Parameters
    ----------
    executor : Executor, optional
        Processes, here or elsewhere.
    function : callable
        Does a piece of work.
    work : sequence of tuples
        Arguments of each piece.

    Yields
    ------
    (number, result)
        Of each piece, as they are done; errors of this package, and the death of a worker, are
        results, too.
    """
    if executor is None:
        for number, arguments in enumerate(work):
            yield number, _attempt(function, *arguments)
        return
    futures = {
        executor.submit(_attempt, function, *arguments): number
        for number, arguments in enumerate(work)
    }
    for future in as_completed(futures):
        try:
            yield futures[future], future.result()
        except BrokenExecutor:
            yield futures[future], Failure("a worker process died, perhaps for want of memory")
        except Exception as error:
            if type(error).__name__ != _KILLED:
                raise
            yield futures[future], Failure("several workers died at it, perhaps for want of memory")


def _attempt(function: Callable[..., _Result], *arguments: Any) -> _Result | Failure:
    # The error itself may not survive the way from one process to another.
    try:
        return function(*arguments)
    except FileError as error:
        return Failure(error.cause)
    except UsmapError as error:
        return Failure(str(error))


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
