"""Set up for all tests."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Iterator
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


@pytest.fixture(autouse=True)
def _untouched_logging() -> Iterator[None]:
    """Leave the package's logger as it was: the command line takes it for itself."""
    logger = logging.getLogger("usmap_ros")
    before = logger.level, logger.propagate, logger.handlers
    yield
    logger.level, logger.propagate, logger.handlers = before


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what only looks at others' recordings, where there are none.

    Whatever they show is shown by simulated or shipped recordings as well.
    """
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
