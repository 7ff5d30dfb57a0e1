"""Threads of this process that compiled loops run in, which hold no lock."""

import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TypeVar

from usmap_ros.processes.cores import available_cores

Part = TypeVar("Part")
Result = TypeVar("Result")

#: Parts that are worked out ahead in each thread, most of which change nothing.
AHEAD = 4

#: How long a thread may keep the others from the interpreter, s: a tenth of what Python lets it.
_TURN_S = 0.0005

#: By how much the priority of what takes seconds is less.
PATIENCE = 10

_of_thread = threading.local()


def for_each(work: Callable[[Part], Result], parts: Iterable[Part]) -> list[Result]:
    """What work makes of each part, in their order, with as many threads as there are cores.

    Parameters
    ----------
    work : callable
        Changes nothing that it also does to another part; what it raises is raised here.
    parts : iterable
        What it is called with.
    """
    parts = list(parts)
    threads = min(available_cores(), len(parts))
    if threads < 2 or getattr(_of_thread, "is_alone", False):
        return [work(part) for part in parts]
    results: dict[int, Result] = {}
    waiting = iter(enumerate(parts))

    def take() -> None:
        for place, part in waiting:
            results[place] = work(part)

    # This thread works, too: it does not wait to be woken, nor for who has not begun.
    helpers = [_executor(os.getpid(), threads - 1).submit(take) for _ in range(threads - 1)]
    try:
        take()
    finally:
        for helper in helpers:
            if not helper.cancel():
                helper.result()
    return [results[place] for place in range(len(parts))]


def in_turn(
    work: Callable[[Part], Result], parts: Iterable[Part], take: Callable[[Part, Result], bool]
) -> None:
    """Take what work makes of each part, in their order, worked out ahead by other threads.

    Parameters
    ----------
    work : callable
        Changes nothing, and gives the same until `take` says that it has changed something.
    parts : iterable
        What it is called with.
    take : callable
        Called with each part and what work makes of it; returns whether work would give something
        else from now on: what was worked out ahead is worked out anew then.
    """
    waiting, ahead = list(parts), 1
    if available_cores() > 1 and not getattr(_of_thread, "is_alone", False):
        ahead = AHEAD * available_cores()
    first = 0
    while first < len(waiting):
        some = waiting[first : first + ahead]
        for part, result in zip(some, for_each(work, some), strict=True):
            first += 1
            if take(part, result):
                break


def begun(work: Callable[[], Result]) -> Future[Result]:
    """What work will give, in a thread beside that no program waits for when it ends."""
    future: Future[Result] = Future()

    def run() -> None:
        try:
            future.set_result(work())
        except BaseException as error:
            future.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    return future


@contextmanager
def alone() -> Iterator[None]:
    """Let `for_each` work in this thread alone meanwhile: what others ask for does not wait."""
    _of_thread.is_alone = True
    try:
        yield
    finally:
        _of_thread.is_alone = False


def take_short_turns() -> None:
    """Let no thread of this process keep the interpreter from the others for long.

    Whoever receives must not wait for heavy work, and a compiled loop of a millisecond, when it
    is done, not for five of whatever runs as Python beside it.
    """
    sys.setswitchinterval(_TURN_S)


def give_way(by: int = PATIENCE) -> None:
    """Leave the cores to this process's other threads, and to other programs, while they want them.

    So do all threads that this one starts.  Linux alone has priorities of threads.

    Parameters
    ----------
    by : int
        By how much the thread's priority is to be less, of 19 in all.
    """
    if sys.platform == "linux":
        thread = threading.get_native_id()
        now = os.getpriority(os.PRIO_PROCESS, thread)
        os.setpriority(os.PRIO_PROCESS, thread, now + by)


@cache
def _executor(process: int, threads: int) -> ThreadPoolExecutor:
    """Threads of a process: what is forked has none of those of its parent."""
    return ThreadPoolExecutor(threads, thread_name_prefix="usmap")
