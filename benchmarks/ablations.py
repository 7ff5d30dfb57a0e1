"""What each part of the product is worth: its maps with one part left out at a time.

The parts are those of `parts`.  F1 and known are means over the scenes and seeds, beside how much
they change without the part; of leak, lost and escape the greatest of any scene stands there, for
safety is that of the worst.

python benchmarks/ablations.py [--cases flat_rough:plain ...] [--seeds 901 ...] [--parts room ...]
    [--cache DIR] [--jobs 2] [--page docs/benchmarks.md]
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from methods import ABLATIONS, METHODS
from pages import put_with_picture
from score_tables import Case, seeds_of, summary
from scores import CHOOSING_SEEDS, all_results

from usmap_ros.plotting import style
from usmap_ros.plotting.style import save_figure

#: Scene and condition of what is mapped if nothing is named: of each kind one.
CASES = (
    "poles:100_pings", "flat_rough:plain", "flat_smooth:plain", "columns_rough:plain",
    "turned_smooth:plain", "depot:plain",
)  # fmt: skip
#: Figures of which the mean counts, and those of which the worst does: heading, field, digits.
MEANS = (("F1", "f1", 3), ("known", "known", 3))
WORST = (("leak", "leak", 3), ("lost", "lost", 3), ("escape m²", "escape_m2", 2))


def worth(rows: list[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Figures of each method over all scenes.

    Parameters
    ----------
    rows : list of dict
        As `score_tables.summary` gives them.
    """
    found = {}
    for method in dict.fromkeys(row["method"] for row in rows):
        own = [row for row in rows if row["method"] == method]
        found[method] = {name: float(np.mean([row[name] for row in own])) for _, name, _ in MEANS}
        found[method] |= {name: max(row[name] for row in own) for _, name, _ in WORST}
    return found


def markdown(found: dict[str, dict[str, float]]) -> str:
    """A row for each part that is left out, the whole first."""
    headings = [f"{heading} | change" for heading, *_ in MEANS]
    headings += [f"worst {heading}" for heading, *_ in WORST]
    lines = [f"| | {' | '.join(headings)} |", "|---|" + "---:|" * (2 * len(MEANS) + len(WORST))]
    for method, figures in found.items():
        cells = [METHODS[method].shown]
        for _, name, digits in MEANS:
            change = figures[name] - found["ours"][name]
            cells += [f"{figures[name]:.{digits}f}", f"{change:+.{digits}f}"]
        cells += [f"{figures[name]:.{digits}f}" for _, name, digits in WORST]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def draw(found: dict[str, dict[str, float]], path: Path) -> None:
    """By how much each figure changes without each part, and the worst figures of safety."""
    left_out = [method for method in found if method != "ours"]
    with style.styled():
        figure = style.new_figure(11.0, 1.2 + 0.3 * len(left_out))
        panels = figure.subplots(1, len(MEANS) + len(WORST), sharey=True)
        for axes, (heading, name, _) in zip(panels, MEANS + WORST, strict=True):
            is_mean = (heading, name) in [each[:2] for each in MEANS]
            base = found["ours"][name]
            values = [found[method][name] - base * is_mean for method in left_out]
            axes.barh(range(len(values)), values, color=style.ROBOTS[0])
            axes.axvline(0.0 if is_mean else base, color=style.FAINT)
            axes.set_xlabel(f"change of {heading}" if is_mean else f"worst {heading}")
        panels[0].set_yticks(range(len(left_out)), [METHODS[each].shown for each in left_out])
        panels[0].invert_yaxis()
    save_figure(figure, path)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", default=CASES, help="scene:condition")
    parser.add_argument("--seeds", nargs="+", type=int, default=CHOOSING_SEEDS)
    names = [name.removeprefix("no_") for name in ABLATIONS]
    parser.add_argument("--parts", nargs="+", choices=names, default=names)
    parser.add_argument("--cache", type=Path, help="folder to keep cones and scores in")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--page", type=Path, help="page to put the table and its picture into")
    arguments = parser.parse_args()
    todo = [
        Case(*each.split(":"), seed=seed) for each in arguments.cases for seed in arguments.seeds
    ]
    methods = ["ours", *(f"no_{name}" for name in arguments.parts)]
    rows = summary(all_results(todo, methods, arguments.cache, jobs=arguments.jobs))
    found = worth(rows)
    table = markdown(found)
    print(table, end="")
    if arguments.page is not None:
        scenes = ", ".join(arguments.cases)
        text = f"{table}\nMeans over, and the worst of: {scenes}. {seeds_of(rows)}\n"
        caption = "Change of F1 and known, and the worst leak, lost and escape, without each part"
        put_with_picture(arguments.page, "ablations", text, caption, partial(draw, found))


if __name__ == "__main__":
    main()
