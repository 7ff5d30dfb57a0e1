"""Processes that are forked to work for this one."""

import logging
import multiprocessing
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, Generic, TypeVar

from usmap_ros.processes.cores import available_cores
from usmap_ros.processes.parent import end_with_parent
from usmap_ros.processes.threads import alone, give_way

logger = logging.getLogger(__name__)

Result = TypeVar("Result")

#: How often who waits for a helper looks up, s.
_LOOK_S = 0.1
#: By how much helpers give way, of 19 in all: nobody waits for them.
HELPERS_PATIENCE = 19
_helpers: list[Executor] = []


@contextmanager
def worker_processes(processes: int) -> Iterator[Executor | None]:
    """Start processes that work for this one, and end them; None where it has to work alone.

    They are forked at once: enter this before anything starts a thread, such as a progress bar.
    One process means none but the caller's, and so does a caller that has threads already:
    what they hold at the fork, the child would wait for in vain.
    """
    if processes <= 1 or not _can_fork():
        yield None
        return
    executor = _forked(processes, _begin_worker)
    try:
        yield executor
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def start_helpers(processes: int) -> None:
    """Fork processes for `Beside`, which stay until this one ends.

    As with `worker_processes`, that has to be done before this process has any threads; there are
    none where it has.
    """
    if _can_fork():
        _helpers.append(_forked(processes, _begin_helper))


class Beside(Generic[Result]):
    """Work of a helper process, if there is one: this one's threads go on meanwhile.

    A thread shares the interpreter with all others of its process, and one that gives way to other
    programs keeps it from them while these run.

    Parameters
    ----------
    work : callable
        A function of a module, of nothing but what it is given, which is pickled, as its result is.
    *given
        What it is called with.
    executor : Executor, optional
        Processes that are taken for helpers, instead of those of `start_helpers`.
    patience : int
        By how much the one that does it gives way from then on, of 19 in all.
    """

    def __init__(
        self,
        work: Callable[..., Result],
        *given: Any,
        executor: Executor | None = None,
        patience: int = 0,
    ) -> None:
        self._work, self._given = work, given
        self._future: Future[Result] | None = None
        if executor is None and _helpers:
            executor = _helpers[-1]
        if executor is not None:
            # If somebody has killed one, this process does the work.
            with suppress(BrokenProcessPool):
                self._future = executor.submit(_patiently, patience, work, *given)

    @property
    def is_done(self) -> bool:
        """Whether nobody has to wait for a helper."""
        return self._future is None or self._future.done()

    def result(self, meanwhile: Callable[[], None] = lambda: None) -> Result:
        """What work gives.

        Parameters
        ----------
        meanwhile : callable
            Called now and then while a helper works; what it raises ends the wait.
        """
        if self._future is not None:
            while not wait([self._future], _LOOK_S).done:
                meanwhile()
            try:
                return self._future.result()
            except BrokenProcessPool:
                logger.warning("a process beside this one was killed; its work is done here")
            meanwhile()
        return _alone(self._work, *self._given)


def _patiently(patience: int, work: Callable[..., Result], *given: Any) -> Result:
    """What work gives in one thread of a process that gives way."""
    give_way(patience)
    return _alone(work, *given)


def _alone(work: Callable[..., Result], *given: Any) -> Result:
    """What work gives in one thread."""
    with alone():
        return work(*given)


class _Processes(ProcessPoolExecutor):
    """Processes that hand results over in files.

    One that is killed while it sends a result through the pipe that all of them share leaves who
    reads it waiting for the rest, for ever.  The name of a file is sent whole or not at all.
    """

    def submit(self, work: Callable[..., Result], /, *given: Any, **named: Any) -> Future[Result]:
        result = Future[Result]()
        result.set_running_or_notify_cancel()
        super().submit(_put, work, *given, **named).add_done_callback(partial(_take, result))
        return result


def _put(work: Callable[..., Any], *given: Any, **named: Any) -> Path | bytes:
    """A file with what work gives; or where there is no place for one, what would be in it."""
    content, path = pickle.dumps(work(*given, **named), pickle.HIGHEST_PROTOCOL), None
    try:
        with NamedTemporaryFile(prefix="usmap_result_", delete=False) as file:
            path = Path(file.name)
            file.write(content)
    except OSError:
        if path is not None:
            path.unlink()
        return content
    return path


def _take(result: Future[Any], handed_over: Future[Path | bytes]) -> None:
    """Give who waits for a result what was handed over, or what went wrong."""
    try:
        given = handed_over.result()
        if isinstance(given, Path):
            content = given.read_bytes()
            given.unlink()
        else:
            content = given
        taken = pickle.loads(content)
    except BaseException as error:
        result.set_exception(error)
    else:
        result.set_result(taken)


def _forked(processes: int, begin: Callable[[int], None]) -> Executor:
    """Processes that have been forked."""
    executor = _Processes(
        processes, mp_context=multiprocessing.get_context("fork"), initializer=begin,
        initargs=(os.getpid(),),
    )  # fmt: skip
    for future in [executor.submit(available_cores) for _ in range(processes)]:
        future.result()
    return executor


def _begin_helper(parent: int) -> None:
    """Begin as a worker does, and leave the cores to others while they want them."""
    _begin_worker(parent)
    # Who ends all processes of a service at once wants the one that started this to end in order.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    give_way(HELPERS_PATIENCE)


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
