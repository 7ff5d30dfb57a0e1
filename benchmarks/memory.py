"""Memory that a program has."""

from __future__ import annotations

from pathlib import Path


def resident_mb() -> float:
    """Memory that this process has now, MB."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) * 1024 / 1e6
    raise RuntimeError("there is no /proc")
