"""Work that is done elsewhere, or here, whoever dies at it: by processes, or by a Dask cluster."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, as_completed
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from usmap_ros.errors import FileError, UsmapError

#: Address of a cluster that is to be started here.
LOCAL = "local"
#: How often Dask tries again what failed because of the worker, not of the work.
RETRIES = 3
#: Dask's error for work at which one worker after the other died.
_KILLED = "KilledWorker"

_Result = TypeVar("_Result")


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
    executor: Executor | None, function: Callable[..., _Result], work: Iterable[tuple[Any, ...]]
) -> Iterator[tuple[int, _Result | Failure]]:
    """Have pieces of work done, by this process if there is no executor.

    Parameters
    ----------
    executor : Executor, optional
        Processes, here or elsewhere.
    function : callable
        Does a piece of work.
    work : iterable of tuples
        Arguments of each piece; the first are begun before the last are asked for.

    Yields
    ------
    (number, result)
        Of each piece, as they are done; errors of this package, and the death of a worker, are
        results, too.
    """
    if executor is None:
        for number, arguments in enumerate(work):
            yield number, attempt(function, *arguments)
        return
    futures = {
        executor.submit(attempt, function, *arguments): number
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


def attempt(function: Callable[..., _Result], *arguments: Any) -> _Result | Failure:
    """Call a function; an error of this package becomes a result."""
    # The error itself may not survive the way from one process to another.
    try:
        return function(*arguments)
    except FileError as error:
        return Failure(error.cause)
    except UsmapError as error:
        return Failure(str(error))
