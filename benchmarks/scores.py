"""How good maps are: the product and other methods; `ablations` has it without its parts.

Every scene is drawn at random by `scenes`, recorded under a condition, and mapped by each method.
F1, recall, known, leak, lost, escape and log loss are those of `usmap evaluate`; "off" is the
largest distance from the diagonal of the reliability diagram of all seeds, where a cell counts as
right if it holds or touches a surface.  Among lone poles those are asked for that are loud enough
to be heard twice, and cells are known "where audible" of those where one would be (`audible`);
elsewhere that is all that was in sight.  Means over the seeds, with standard deviations behind ±.

python benchmarks/scores.py [-o bench_output/scores] [--scenes poles ... | --targets] [--compared]
    [--conditions plain ...] [--seeds 901 ... | --report] [--methods ours ...]
    [--nav2-map MAP.yaml ...] [--cache DIR] [--jobs 2] [--page docs/benchmarks.md] [--place poses]
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from audible import audible_poles, known_where_audible
from kept import KeptResults
from methods import ABLATIONS, CONVERGENCE, METHODS
from pages import put, put_with_picture
from recordings import Cones, cones
from rich.progress import track
from scenes import CONDITIONS, KINDS, scenario
from score_pictures import draw_maps, draw_scores
from score_tables import (
    SHOWN_METHODS,
    Case,
    Result,
    compared_table,
    markdown,
    readme_table,
    seeds_of,
    summary,
    targets_table,
)
from targets import TARGETS

from usmap_ros.evaluation.reliability import reliability
from usmap_ros.evaluation.scoring import score
from usmap_ros.evaluation.sight import is_lone_poles
from usmap_ros.grids import OccupancyMap
from usmap_ros.pings.fields_of_view import PingViews

#: Seeds that settings may be chosen by, and seeds of figures that are reported: nothing is chosen
#: by those, and none of their maps is looked at before.
CHOOSING_SEEDS, REPORTED_SEEDS = (901, 902, 903), (971, 972, 973)
#: Scenes that are recorded under more than the plain condition if none is named, and which.
VARIED = ("poles", "rough_rooms")
VARIATIONS = (
    "plain", "noisy", "few_pings", "one_robot", "six_robots", "poses_off", "headings_off",
    "poses_drift",
)  # fmt: skip
#: Pings that are mapped before the time of a method is taken.
WARMING_PINGS = 60
#: Methods whose machine code this process has.
_WARM: set[str] = set()


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
        usual = VARIATIONS if name in VARIED else ("plain",)
        for condition in conditions or usual:
            found += [Case(name, condition, seed, path) for seed in seeds]
    return found


def target_cases(seeds: Iterable[int]) -> list[Case]:
    """Whatever `targets` speaks of."""
    pairs = dict.fromkeys(pair for target in TARGETS for pair in target.cases)
    return [Case(scene, condition, seed) for scene, condition in pairs for seed in seeds]


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
    sensor = CONDITIONS[case.condition].sensor
    kept = KeptResults(None if cache is None else cache / "scores")
    picture = pictures and pictures / f"{case.scene}_{case.condition}_{case.seed}.png"
    must_draw = picture is not None and not picture.exists()
    truth, found, maps = world.truth_map(), [], {}
    views = None
    for name in methods:
        method = METHODS[name]
        judged = None if must_draw else kept.get(world, sensor, method)
        if judged is None:
            recorded = cones(world, method.parameters().reconstruction, cache, sensor)
            views = views or PingViews.of(cone for _, cone in recorded)
            occupancy, ms_per_ping = timed_map(name, recorded)
            if sensor == "sonar" and is_lone_poles(truth):
                scored = score(occupancy, truth, views, audible_poles(world, recorded, truth))
                known_audible = known_where_audible(world, recorded, occupancy, truth)
            else:
                scored = score(occupancy, truth, views)
                known_audible = scored.known
            judged = scored, reliability(occupancy, truth), ms_per_ping, known_audible
            maps[f"{method.shown}\nF1 {scored.f1:.2f}, known {scored.known:.2f}"] = occupancy
            kept.put(world, sensor, method, judged)
        found.append(Result(case, name, *judged))
    if must_draw and picture is not None and views is not None:
        draw_maps(maps, truth, views, picture)
    return found


def timed_map(name: str, recorded: Cones) -> tuple[OccupancyMap, float]:
    """A method's map, and how long it took with one core, in ms a ping.

    Machine code is made or loaded beforehand.
    """
    method = METHODS[name]
    if name not in _WARM:
        method.map(recorded[:WARMING_PINGS])
        _WARM.add(name)
    begun_s = time.process_time()
    occupancy = method.map(recorded)
    return occupancy, 1e3 * (time.process_time() - begun_s) / len(recorded)


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


def main() -> None:
    """Print the table, and write it with its pictures."""
    arguments = _parsed()
    output: Path = arguments.output
    (output / "maps").mkdir(parents=True, exist_ok=True)
    seeds, nav2_maps = arguments.seeds, arguments.nav2_map
    if arguments.targets:
        todo = target_cases(seeds)
    else:
        todo = cases(arguments.scenes, arguments.conditions, seeds, nav2_maps)
    results = all_results(todo, arguments.methods, arguments.cache, output / "maps", arguments.jobs)
    rows = summary(results)
    table = markdown(rows)
    if arguments.compared:
        table = compared_table(rows)
    elif arguments.targets:
        table = targets_table(rows)
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
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0],
        epilog=f"Seeds {', '.join(map(str, CHOOSING_SEEDS))} are for choosing settings;"
        f" {', '.join(map(str, REPORTED_SEEDS))} for what is reported, and nothing else.",
    )
    parser.add_argument("-o", "--output", type=Path, default=Path("bench_output/scores"))
    parser.add_argument("--scenes", nargs="*", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--conditions", nargs="+", choices=list(CONDITIONS))
    seeds = parser.add_mutually_exclusive_group()
    seeds.add_argument(
        "--seeds", nargs="+", type=int, default=CHOOSING_SEEDS, help="default: those for choosing"
    )
    seeds.add_argument(
        "--report",
        dest="seeds",
        action="store_const",
        const=REPORTED_SEEDS,
        help="take the seeds that nothing is chosen by",
    )
    parser.add_argument(
        "--targets",
        action="store_true",
        help="run what there are targets for, of ours and range only unless --methods says more",
    )
    parser.add_argument(
        "--compared",
        action="store_true",
        help="say by how much F1 and known of other methods differ from ours",
    )
    usual = [name for name in METHODS if name not in ABLATIONS | CONVERGENCE]
    parser.add_argument("--methods", nargs="+", choices=list(METHODS))
    parser.add_argument("--nav2-map", nargs="+", type=Path, default=[], help="further worlds")
    parser.add_argument("--cache", type=Path, help="folder to keep cones and scores in")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--readme", type=Path, help="page to put ours and range only into")
    parser.add_argument("--page", type=Path, help="page to put the table and its picture into")
    parser.add_argument("--place", default="scores", help="name of the table's place on that page")
    arguments = parser.parse_args()
    if arguments.methods is None:
        arguments.methods = list(SHOWN_METHODS) if arguments.targets else usual
    return arguments


if __name__ == "__main__":
    main()
