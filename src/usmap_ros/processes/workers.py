"""Processes that are forked to work for this one."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from usmap_ros.processes.cores import available_cores
from usmap_ros.processes.parent import end_with_parent


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
