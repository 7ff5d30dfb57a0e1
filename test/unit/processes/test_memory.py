"""How much memory a program takes, and what becomes of what is not used any more."""

import ctypes
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from usmap_ros.processes.memory import give_back_memory

PRINT_PEAK = "from usmap_ros.processes.memory import peak_memory_mb; print(peak_memory_mb())"


def resident_mb() -> float:
    """Memory that this process has."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024.0
    raise AssertionError


@pytest.mark.skipif(
    sys.platform != "linux" or not hasattr(ctypes.CDLL(None), "malloc_trim"),
    reason="the C library has no such call",
)
def test_what_is_let_go_is_given_back_though_something_behind_it_stays() -> None:
    arrays = [np.ones(7_500) for _ in range(2_000)]
    stays = arrays[::500] + arrays[-1:]
    arrays.clear()
    before_mb = resident_mb()

    give_back_memory()

    assert before_mb - resident_mb() > 50.0
    assert all(array.all() for array in stays)


def test_the_memory_of_whoever_started_it_does_not_count() -> None:
    """getrusage alone would report it: a process starts as a copy of its parent."""
    parent = (
        "import subprocess, sys\n"
        "block = bytearray(b'x') * 600_000_000\n"
        f"subprocess.run([sys.executable, '-c', {PRINT_PEAK!r}], check=True)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", parent], capture_output=True, text=True, check=True
    )
    assert 10.0 < float(done.stdout) < 400.0
