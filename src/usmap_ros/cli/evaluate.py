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
    from usmap_ros.evaluation.trajectories import PathScore
    from usmap_ros.grids import OccupancyMap
    from usmap_ros.pings.robot_paths import RobotPaths


def evaluate(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that 'usmap map' wrote.")],
    truth: Annotated[
        Path | None, typer.Option(metavar="MAP.yaml", help="nav2 map of what is really there.")
    ] = None,
    true_paths: Annotated[
        Path | None,
        typer.Option(
            "--paths",
            metavar="TRUTH.tum",
            help="TUM file of where the robots really were, or a folder with one for each, named"
            " as 'usmap simulate --true-paths' does: compare the map's paths with it.",
        ),
    ] = None,
    align: Annotated[
        bool, typer.Option(help="Lay the paths over the true ones first, all as one; with --paths.")
    ] = False,
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
    """Score a map against a truth map, and its paths against the true ones."""
    from usmap_ros.io.map_files import load_map

    if truth is None and true_paths is None:
        raise typer.BadParameter("is missing, and so is --paths", param_hint="'--truth'")
    for option, value, other, needed in (
        ("--align", align or None, "--paths", true_paths),
        ("--max-range", max_range, "--truth", truth),
        ("--beside", beside, "--truth", truth),
    ):
        if value is not None and needed is None:
            raise typer.BadParameter(f"goes with {other}", param_hint=f"'{option}'")
    occupancy, paths = load_map(folder)
    content: dict[str, Any] = {}
    if truth is not None:
        scores = _score_maps(folder, truth, (occupancy, paths), beside, max_range)
        content |= _finite(scores[0])
        if beside is not None:
            content["beside"] = _finite(scores[1])
        if not as_json:
            _show(folder, truth, beside, scores)
    if true_paths is not None:
        path_scores = _score_paths(paths, true_paths, align=align)
        content["paths"] = {name: _finite(one) for name, one in path_scores.items()}
        if not as_json:
            told = {name: describe_path(one) for name, one in path_scores.items()}
            console.print_facts(f"paths of {folder} against {true_paths}", told)
    if as_json:
        typer.echo(json.dumps(content, indent=2))


def _score_maps(
    folder: Path,
    truth: Path,
    ours: tuple[OccupancyMap, RobotPaths],
    beside: Path | None,
    max_range_m: float | None,
) -> list[Score]:
    """Scores of the map, and of another one if there is one."""
    from usmap_ros.evaluation.scoring import score
    from usmap_ros.io.map_files import load_map, load_truth

    occupancy, paths = ours
    views = paths.views(max_range_m)
    if max_range_m is not None and (views is None or paths.views() is not None):
        raise typer.BadParameter(
            f"{folder} holds {'no pings' if views is None else 'the beams of all its pings'}",
            param_hint="'--max-range'",
        )
    really = load_truth(truth)
    scores = [score(occupancy, really, views)]
    if beside is not None:
        other, other_paths = load_map(beside)
        scores.append(score(other, really, other_paths.views(max_range_m)))
    return scores


def _show(folder: Path, truth: Path, beside: Path | None, scores: list[Score]) -> None:
    """Print scores of maps for people."""
    shown = [describe(one) for one in scores]
    if beside is None:
        console.print_facts(f"{folder} against {truth}", shown[0])
        return
    names = dict.fromkeys(name for facts in shown for name in facts)
    rows = [[name, *(facts.get(name, "") for facts in shown)] for name in names]
    console.print_table(f"Scored against {truth}", ["", str(folder), str(beside)], rows)


def _score_paths(paths: RobotPaths, truth: Path, *, align: bool) -> dict[str, PathScore]:
    from usmap_ros.errors import UsmapError
    from usmap_ros.evaluation.trajectories import score_paths
    from usmap_ros.io.tum_files import SUFFIX, file_name, load_trajectories

    ours = {file_name(topic): path for topic, path in paths.trajectories().items()}
    if not ours:
        raise UsmapError("the map holds no paths with stamps; map the recording anew")
    scores = score_paths(ours, load_trajectories(truth), aligned=align)
    return {name.removesuffix(SUFFIX): one for name, one in scores.items()}


def _finite(score: Score | PathScore) -> dict[str, Any]:
    """Fields of a score; JSON knows no NaN."""
    from dataclasses import asdict

    return {name: value if math.isfinite(value) else None for name, value in asdict(score).items()}


def describe_path(score: PathScore) -> str:
    """How far a path is off, for people."""
    return (
        f"ATE {score.ate_m:.3f} m (at most {score.ate_max_m:.3f} m),"
        f" {math.degrees(score.ate_rad):.2f}°; RPE {score.rpe_m:.4f} m,"
        f" {math.degrees(score.rpe_rad):.2f}°; {score.poses} poses"
    )


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
