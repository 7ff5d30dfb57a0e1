"""What ``usmap map`` says when the map is done."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from usmap_ros.runs.offline import MappingRun

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


def _apart(run: MappingRun) -> str:
    """Pings that are set apart, as the end of a line; nothing if there are none."""
    found = [
        f"{count} of {topic} {why}"
        for topic, counts in run.set_apart.items()
        for why, count in counts.items()
    ]
    return f"; set apart: {', '.join(found)}" if found else ""


def tell(output: Path, run: MappingRun, summary: dict[str, Any], *, as_json: bool) -> None:
    """Warn of robots that others contradict, and sum up: in a line, or all as JSON."""
    from usmap_ros.io.map_files import NAV2_FILE

    for topic, problem in run.suspects().items():
        counted = "for nothing" if run.poses.parameters.mapping.weigh_robots else "all the same"
        said = f"its pings count {counted}; --without {topic} leaves it out"
        typer.echo(f"usmap: warning: {topic}: {problem}; {said}", err=True)
    for topic, problem in run.contradicted().items():
        typer.echo(f"usmap: warning: {topic}: {problem}; nobody can tell which is wrong", err=True)
    for topic, share in run.doubted.items():
        said = f"others contradict it; in the map it counts for {share:.0%} of what it says"
        typer.echo(f"usmap: warning: {topic}: {said}", err=True)
    for reason in run.common_error.reasons:
        said = "not on the map; --set mapping.correct_common_errors=false keeps them so"
        typer.echo(f"usmap: warning: {reason}; {said}", err=True)
    if as_json:
        typer.echo(json.dumps(summary, indent=2))
    else:
        typer.echo(
            f"{output / NAV2_FILE}: {run.pings} pings, {run.echoes} echoes,"
            f" {summary['cells_occupied']} of {summary['cells_observed']} observed cells occupied;"
            f" {summary['seconds']:.1f} s, {summary['pings_per_second']:.0f} pings/s"
            f"{_apart(run)}"
        )
