"""``usmap status``: how the nodes that run are."""

import dataclasses
import json
from typing import Annotated

import typer

from usmap_ros.live.requirements import require_ros

#: What a line has room for, with units of two letters; --json has every figure.
_FIGURES = {"rate (Hz)": "Hz", "latency p50 (ms)": "ms"}


def status(
    wait: Annotated[
        float, typer.Option(min=0.1, max=600.0, metavar="S", help="How long to listen, in seconds.")
    ] = 3.0,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print every figure of every node as JSON.")
    ] = False,
) -> None:
    """Show what the nodes say of themselves on /diagnostics, a line each."""
    require_ros()
    from usmap_ros.errors import UsmapError
    from usmap_ros.nodes.plumbing.status import collect_reports

    reports = collect_reports(wait)
    if not reports:
        raise UsmapError(f"no node has said anything on /diagnostics within {wait:g} s")
    if as_json:
        content = {
            name: {**dataclasses.asdict(report), "level": report.level.name}
            for name, report in reports.items()
        }
        typer.echo(json.dumps(content, indent=2))
        return
    width = max(map(len, reports))
    for name, report in reports.items():
        figures = "".join(
            f"{report.facts[figure]:>9} {unit}" if figure in report.facts else " " * 12
            for figure, unit in _FIGURES.items()
        )
        typer.echo(f"{report.level.name:5} {name:{width}}{figures}  {report.message}")
