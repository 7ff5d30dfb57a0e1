"""How long a command has taken, as who started it sees it."""

from __future__ import annotations

import os
import time
from pathlib import Path

_IMPORTED_S = time.perf_counter()


def seconds_since_start() -> float:
    """Seconds since the process was started, imports and all; not on Linux, since some of them."""
    try:
        # The command's name may hold spaces, and is in brackets; the start is the 22nd field.
        fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        started_s = int(fields[19]) / os.sysconf("SC_CLK_TCK")
        return time.clock_gettime(time.CLOCK_BOOTTIME) - started_s
    except (OSError, ValueError, IndexError, AttributeError):
        return time.perf_counter() - _IMPORTED_S
