"""``usmap evaluate``: a map against the truth."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from usmap_ros.cli import console

if TYPE_CHECKING:
    from usmap_ros.evaluation.scoring import Score


def evaluate(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that 'usmap map' wrote.")],
    truth: Annotated[
        Path, typer.Option(metavar="MAP.yaml", help="nav2 map of what is really there.")
    ],
    max_range: Annotated[
        float | None,
        typer.Option(
            metavar="M",
            min=0.0,
            help="How far pings reached, all around, of which the map holds positions only.",
        ),
    ] = None,
    beside: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Another map to score beside it, such as that of 'usmap map --method range_only'.",
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the score as JSON.")] = False,
) -> None:
    """Score a map against a truth map."""
    from usmap_ros.evaluation.scoring import score
    from usmap_ros.io.map_files import load_map, load_truth

    occupancy, paths = load_map(folder)
    views = paths.views(max_range)
    if max_range is not None and (views is None or paths.views() is not None):
        raise typer.BadParameter(
            f"{folder} holds {'no pings' if views is None else 'the beams of all its pings'}",
            param_hint="'--max-range'",
        )
    really = load_truth(truth)
    scores = [score(occupancy, really, views)]
    if beside is not None:
        other, other_paths = load_map(beside)
        scores.append(score(other, really, other_paths.views(max_range)))
    if as_json:
        content = _finite(scores[0])
        if beside is not None:
            content["beside"] = _finite(scores[1])
        typer.echo(json.dumps(content, indent=2))
        return
    shown = [describe(one) for one in scores]
    if beside is None:
        console.print_facts(f"{folder} against {truth}", shown[0])
        return
    names = dict.fromkeys(name for facts in shown for name in facts)
    rows = [[name, *(facts.get(name, "") for facts in shown)] for name in names]
    console.print_table(f"Scored against {truth}", ["", str(folder), str(beside)], rows)


def _finite(score: Score) -> dict[str, Any]:
    """Fields of a score; JSON knows no NaN."""
    from dataclasses import asdict

    return {name: value if math.isfinite(value) else None for name, value in asdict(score).items()}


def describe(score: Score) -> dict[str, str]:
    """Score in words and figures, for people."""
    facts = {
        "F1": f"{score.f1:.3f}",
        "known (of open space in sight)": f"{score.known:.3f}",
        "precision": f"{score.precision:.3f}",
        "recall (of surfaces in sight)": f"{score.recall:.3f}",
        "log loss": f"{score.log_loss:.4f}",
        "Brier score": f"{score.brier:.4f}",
        "mean distance": f"{score.mean_distance_m * 100:.1f} cm",
    }
    if not score.sight_known:
        return facts | {"in sight": "not known: what lies within a cell of what is observed"}
    return facts | {
        "leak (free, but out of sight)": f"{score.leak:.1%}",
        "lost (seen walls called free)": f"{score.lost:.1%}",
        "escape (reached, out of sight)": f"{score.escape_m2:.2f} m²",
    }
