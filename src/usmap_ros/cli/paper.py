"""``usmap paper``: the paper's figures, reproduced, and its study taken further."""

from pathlib import Path
from typing import Annotated, Any

import typer

from usmap_ros.cli import console


def paper(
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="Folder for the pictures.")
    ],
) -> None:
    """Reproduce the paper's figures and its study; docs/paper.md walks through them."""
    from usmap_ros.paper.study import NUMBERS_FILE, PARTS, run_study

    console.compile_loops()
    with console.progress("reproducing the paper", len(PARTS)) as step:
        numbers = run_study(output, step)
    _print_solvers(numbers["solvers_table"]["summary"])
    typer.echo(
        f"{output / NUMBERS_FILE}: {len(PARTS)} pictures and their numbers,"
        f" {numbers['seconds']:.0f} s"
    )


def _print_solvers(summary: list[dict[str, Any]]) -> None:
    rows = [
        [
            row["solver"],
            f"{100.0 * row['support_found']:.0f} %",
            f"{row['f1']:.2f}",
            f"{row['relative_residual']:.2f}",
            f"{row['milliseconds']:.1f}",
        ]
        for row in summary
    ]
    console.print_table(
        "Solvers, on the grid, over noise levels and numbers of objects",
        ["solver", "support found", "F1", "relative residual", "ms a ping"],
        rows,
    )
