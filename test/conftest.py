"""Set up for all tests."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from usmap_ros.processes.cores import keep_linear_algebra_to_one_core

# Before NumPy is imported, and most of all where several test processes share the machine.
keep_linear_algebra_to_one_core()

# What a script runs in the background ignores Ctrl-C, and so would all that tests start.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples at each run, however fast or busy the machine is.
settings.register_profile(
    "steady", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("steady")

#: Recordings and maps that others made: beside the checkout, or where USMAP_SHARED says.
SHARED = Path(os.environ.get("USMAP_SHARED", Path(__file__).parents[2] / "shared"))

#: Files whose tests take half a minute or more.
LONGEST = {"test_carried_off.py", "test_consistency.py", "test_joining.py", "test_study.py"}


@contextlib.contextmanager
def untouched_logging() -> Iterator[None]:
    """Leave the package's logger as it was: the command line takes it for itself."""
    logger = logging.getLogger("usmap_ros")
    before = logger.level, logger.propagate, logger.handlers
    yield
    logger.level, logger.propagate, logger.handlers = before


@pytest.fixture(autouse=True)
def _untouched_logging() -> Iterator[None]:
    """Leave the package's logger as it was in every test."""
    with untouched_logging():
        yield


@dataclass(frozen=True)
class Done:
    """How a run of the program ended."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture(scope="session")
def usmap() -> Callable[..., Done]:
    """Give a function that runs the program, in this process because that is much faster."""
    # Not above, where NumPy is not to be imported yet.
    from usmap_ros.cli import main
    from usmap_ros.runs.compilation import compile_if_needed

    # Or the first command would, and say so.
    compile_if_needed(lambda line: None)

    def run(*arguments: str, cwd: Path) -> Done:
        output, errors = io.StringIO(), io.StringIO()
        status = 0
        with (
            pytest.MonkeyPatch.context() as patch,
            contextlib.redirect_stdout(output),
            contextlib.redirect_stderr(errors),
            untouched_logging(),
        ):
            patch.setattr(sys, "argv", ["usmap", *arguments])
            patch.chdir(cwd)
            try:
                main()
            except SystemExit as end:
                status = end.code if isinstance(end.code, int) else int(end.code is not None)
        return Done(status, output.getvalue(), errors.getvalue())

    return run


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with what takes longest, so that no process is left with it while others have ended.

    What only looks at others' recordings is left out where there are none.  Whatever they show is
    shown by simulated or shipped recordings as well.
    """
    items.sort(key=lambda item: item.path.name not in LONGEST)
    if SHARED.is_dir():
        return
    left_out = [item for item in items if item.get_closest_marker("recordings")]
    if left_out:
        items[:] = [item for item in items if item not in left_out]
        config.hook.pytest_deselected(items=left_out)


@pytest.fixture(scope="session")
def shared_folder() -> Path:
    """Give the folder of others' recordings; for tests with the mark ``recordings``."""
    return SHARED
