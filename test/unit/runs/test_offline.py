"""What a summary says of a mapping run."""

import subprocess
import sys

PRINT_PEAK = "from usmap_ros.runs.offline import peak_memory_mb; print(peak_memory_mb())"


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
