"""How good maps are: the product, what it is without one of its parts, and other methods.

Every scene is drawn at random by `scenes`, recorded under a condition, and mapped by each method.
F1, recall, known, leak, lost, escape and log loss are those of `usmap evaluate`; "off" is the
largest distance from the diagonal of the reliability diagram of all seeds, where a cell counts as
right if it holds or touches a surface.  Means over the seeds, with the standard deviation behind ±.

python benchmarks/scores.py [-o bench_output/scores] [--scenes poles ...] [--conditions plain ...]
    [--seeds 901 ...] [--methods ours ...] [--ablations] [--nav2-map MAP.yaml ...] [--cache DIR]
    [--jobs 2] [--page docs/benchmarks.md] [--place ablations]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from kept import KeptResults
from methods import ABLATIONS, METHODS
from pages import put, put_with_picture
from recordings import cones
from rich.progress import track
from scenes import CONDITIONS, KINDS, scenario
from score_pictures import draw_maps, draw_scores

from usmap_ros.evaluation.reliability import Reliability, reliability
from usmap_ros.evaluation.scoring import Score, score
from usmap_ros.pings.fields_of_view import PingViews

SEEDS = (901, 902, 903)
#: Under which conditions other than the plain one scenes are recorded, if none is named.
VARIED = ("poles", "rough_rooms")
#: Columns of the table: heading, field of the score, digits.
COLUMNS = (
    ("F1", "f1", 2),
    ("recall", "recall", 2),
    ("known", "known", 2),
    ("leak", "leak", 3),
    ("lost", "lost", 3),
    ("escape m²", "escape_m2", 2),
    ("log loss", "log_loss", 3),
)
#: Of them, in the table of the README; and whose they are.
SHOWN_COLUMNS = ("f1", "known", "leak", "lost", "escape_m2")
SHOWN_METHODS = ("ours", "range_only")


@dataclass(frozen=True)
class Case:
    """A scene to be recorded and mapped.

    Parameters
    ----------
    scene, condition : str
        As in `scenes`; of a nav2 map, the scene is its name.
    seed : int
        Of everything random.
    nav2_map : path, optional
        Its world, instead of a drawn one.
    """

    scene: str
    condition: str
    seed: int
    nav2_map: Path | None = None

    @property
    def row(self) -> tuple[str, str]:
        """Scene and condition."""
        return self.scene, self.condition


@dataclass(frozen=True)
class Result:
    """What a method made of a case."""

    case: Case
    method: str
    score: Score
    reliability: Reliability


def cases(
    scenes: Iterable[str],
    conditions: Iterable[str] | None,
    seeds: Iterable[int],
    nav2_maps: Iterable[Path] = (),
) -> list[Case]:
    """What is to be done: every scene plainly, and `VARIED` under all conditions if none is named.

    Parameters
    ----------
    scenes, conditions : iterable of str
        As in `scenes`.
    seeds : iterable of int
        Of everything random.
    nav2_maps : iterable of path
        Further worlds.
    """
    seeds = list(seeds)
    worlds: list[tuple[str, Path | None]] = [(name, None) for name in scenes]
    worlds += [(path.stem, path) for path in nav2_maps]
    found = []
    for name, path in worlds:
        usual = list(CONDITIONS) if name in VARIED else ["plain"]
        for condition in conditions or usual:
            found += [Case(name, condition, seed, path) for seed in seeds]
    return found


def results_of(
    case: Case, methods: Iterable[str], cache: Path | None = None, pictures: Path | None = None
) -> list[Result]:
    """Record a case, map it by each method, and score the maps.

    Parameters
    ----------
    case : Case
        The scene.
    methods : iterable of str
        As in `methods`.
    cache : path, optional
        Folder where cones and scores are kept.
    pictures : path, optional
        Folder for a picture of all maps; one that is there already is not drawn again.
    """
    world = scenario(case.scene, case.condition, case.seed, case.nav2_map)
    kept = KeptResults(None if cache is None else cache / "scores")
    picture = pictures and pictures / f"{case.scene}_{case.condition}_{case.seed}.png"
    must_draw = picture is not None and not picture.exists()
    truth, found, maps = world.truth_map(), [], {}
    views = None
    for name in methods:
        method = METHODS[name]
        judged = None if must_draw else kept.get(world, method)
        if judged is None:
            recorded = cones(world, method.parameters().reconstruction, cache)
            views = views or PingViews.of(cone for _, cone in recorded)
            occupancy = maps[method.shown] = method.map(recorded)
            judged = score(occupancy, truth, views), reliability(occupancy, truth)
            kept.put(world, method, judged)
        found.append(Result(case, name, *judged))
    if must_draw and picture is not None and views is not None:
        draw_maps(maps, truth, views, picture)
    return found


def all_results(
    todo: list[Case],
    methods: list[str],
    cache: Path | None = None,
    pictures: Path | None = None,
    jobs: int = 1,
) -> list[Result]:
    """`results_of` all cases, pictures of the first seed only."""
    first = {case.row: case for case in reversed(todo)}
    folders = [pictures if first[case.row] is case else None for case in todo]
    arguments = (todo, [methods] * len(todo), [cache] * len(todo), folders)

    def shown(done: Iterator[list[Result]]) -> list[Result]:
        progress = track(done, description="Scoring", total=len(todo), transient=True)
        return [result for part in progress for result in part]

    if jobs == 1:
        return shown(map(results_of, *arguments))
    with ProcessPoolExecutor(jobs) as executor:
        return shown(executor.map(results_of, *arguments))


def summary(results: list[Result]) -> list[dict[str, Any]]:
    """A row for each scene, condition and method: means and standard deviations over the seeds."""
    rows = []
    for (scene, condition), same_row in groupby(results, key=lambda result: result.case.row):
        by_method: dict[str, list[Result]] = {}
        for result in same_row:
            by_method.setdefault(result.method, []).append(result)
        for method, seeds in by_method.items():
            row: dict[str, Any] = {"scene": scene, "condition": condition, "method": method}
            row["seeds"] = [result.case.seed for result in seeds]
            for _, name, _ in COLUMNS:
                values = np.array([asdict(result.score)[name] for result in seeds])
                row[name], row[f"{name}_std"] = float(values.mean()), float(values.std())
            counts = [result.reliability for result in seeds]
            row["off"] = sum(counts[1:], start=counts[0]).worst()
            rows.append(row)
    return rows


def markdown(rows: list[dict[str, Any]]) -> str:
    """The rows as a table."""
    headings = ["scene", "method", *(heading for heading, _, _ in COLUMNS), "off"]
    lines = [f"| {' | '.join(headings)} |", "|---|---|" + "---:|" * (len(headings) - 2)]
    for row in rows:
        scene = row["scene"].replace("_", " ")
        if row["condition"] != "plain":
            scene += f", {CONDITIONS[row['condition']].shown}"
        figures = [
            f"{row[name]:.{digits}f} ± {row[f'{name}_std']:.{digits}f}"
            for _, name, digits in COLUMNS
        ]
        cells = [scene, METHODS[row["method"]].shown, *figures, f"{row['off']:.2f}"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def readme_table(rows: list[dict[str, Any]]) -> str:
    """`SHOWN_COLUMNS` of ours beside range only."""
    columns = [column for column in COLUMNS if column[1] in SHOWN_COLUMNS]
    headings = " | ".join(heading for heading, _, _ in columns)
    lines = [
        f"| scene | {headings} | range only: {headings} |",
        "|---|" + "---:|" * (len(SHOWN_METHODS) * len(columns)),
    ]
    for _, pair in groupby(rows, key=lambda row: (row["scene"], row["condition"])):
        by_method = {row["method"]: row for row in pair}
        figures = [
            f"{by_method[method][name]:.{digits}f}"
            for method in SHOWN_METHODS
            for _, name, digits in columns
        ]
        scene = by_method["ours"]["scene"].replace("_", " ")
        lines.append(f"| {scene} | {' | '.join(figures)} |")
    lines += ["", seeds_of(rows)]
    return "\n".join(lines) + "\n"


def seeds_of(rows: list[dict[str, Any]]) -> str:
    """A sentence that says which seeds the rows are from."""
    seeds = sorted({seed for row in rows for seed in row["seeds"]})
    return f"Seeds: {', '.join(map(str, seeds))}."


def main() -> None:
    """Print the table, and write it with its pictures."""
    arguments = _parsed()
    output: Path = arguments.output
    (output / "maps").mkdir(parents=True, exist_ok=True)
    todo = cases(arguments.scenes, arguments.conditions, arguments.seeds, arguments.nav2_map)
    results = all_results(todo, arguments.methods, arguments.cache, output / "maps", arguments.jobs)
    rows = summary(results)
    table = markdown(rows)
    print(table, end="")
    (output / "scores.md").write_text(table, encoding="utf-8")
    (output / "scores.json").write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")
    draw_scores(rows, output / "scores.png")
    if arguments.readme is not None:
        put(arguments.readme, "scores", readme_table(rows))
    if arguments.page is not None:
        caption = "F1, known, leak, lost and escape of every method on every scene"
        picture = partial(draw_scores, rows)
        text = f"{table}\n{seeds_of(rows)}\n"
        put_with_picture(arguments.page, arguments.place, text, caption, picture)


def _parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("bench_output/scores"))
    parser.add_argument("--scenes", nargs="*", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--conditions", nargs="+", choices=list(CONDITIONS))
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    usual = [name for name in METHODS if name not in ABLATIONS]
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=usual)
    parser.add_argument(
        "--ablations", action="store_true", help="also ours without each of its parts"
    )
    parser.add_argument("--nav2-map", nargs="+", type=Path, default=[], help="further worlds")
    parser.add_argument("--cache", type=Path, help="folder to keep cones and scores in")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--readme", type=Path, help="page to put ours and range only into")
    parser.add_argument("--page", type=Path, help="page to put the table and its picture into")
    parser.add_argument("--place", default="scores", help="name of the table's place on that page")
    arguments = parser.parse_args()
    if arguments.ablations:
        arguments.methods += [name for name in ABLATIONS if name not in arguments.methods]
    return arguments


if __name__ == "__main__":
    main()
