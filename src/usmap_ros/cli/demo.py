"""``usmap demo``: the main job, end to end."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usmap_ros.cli import console
from usmap_ros.cli.evaluate import describe

if TYPE_CHECKING:
    from usmap_ros.runs.demo import DemoResult


def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for all that it makes.")
    ] = Path("usmap_demo"),
) -> None:
    """Simulate several robots, record them, map the recording, score it and draw it all."""
    from usmap_ros.runs.demo import run_demo

    _report(run_demo(output, console.progress, console.compile_loops))


def _report(result: DemoResult) -> None:
    summary = result.summary
    console.print_facts(
        f"Mapped {summary['pings']} pings in {summary['seconds']:.1f} s", _shown(result.paths)
    )
    ours, theirs = describe(result.score), describe(result.range_score)
    console.print_table(
        "Scored against the truth",
        ["", "usmap", "range-only sonar"],
        [[name, value, theirs[name]] for name, value in ours.items()],
    )


def _shown(paths: dict[str, Path]) -> dict[str, str]:
    return {name: str(path) for name, path in paths.items()}
