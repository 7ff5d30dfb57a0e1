"""Whether maps mean their probabilities: of cells given 0.8, about 80 % should hold a surface.

Pools the observed cells of maps of several scenes that no parameter was chosen on, and tells how
far a bin is from the diagonal, of those bins above 0.05 that hold more than 1 % of the cells above
0.05. A cell is right if it holds a surface, or, in the other reading, if it holds or touches one.

python benchmarks/reliability.py [-o bench_output/reliability.png] [--seeds 921 ...] [--cache DIR]
    [--jobs 2] [--page docs/benchmarks.md]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from pages import put_with_picture
from scores import all_results, cases

from usmap_ros.evaluation.reliability import BINS, LEAST_SHARE, SURELY_FREE, Reliability
from usmap_ros.plotting import style
from usmap_ros.plotting.style import save_figure

#: Kinds of scenes that are pooled, by what they are called together.
POOLS = {
    "poles": ("poles",),
    "rough rooms": ("rough_rooms", "corridors", "corners", "clutter"),
    "smooth rooms": ("smooth_rooms",),
}
SEEDS = tuple(range(921, 927))


def pooled(
    seeds: Iterable[int] = SEEDS, cache: Path | None = None, jobs: int = 1
) -> dict[str, Reliability]:
    """Reliability of the product's maps of each pool of scenes."""
    found: dict[str, Reliability] = {}
    for name, scenes in POOLS.items():
        results = all_results(cases(scenes, ["plain"], seeds), ["ours"], cache, jobs=jobs)
        counts = [result.reliability for result in results]
        found[name] = sum(counts[1:], start=counts[0])
    return found


def draw(found: dict[str, Reliability], path: Path) -> None:
    """One diagram for each pool: shares that hold and that touch, by mean probability."""
    with style.styled():
        figure = style.new_figure(3.4 * len(found), 3.8)
        for axes, (name, counts) in zip(figure.subplots(1, len(found)), found.items(), strict=True):
            _draw_pool(axes, name, counts)
        style.legend_below(figure, *figure.axes[0].get_legend_handles_labels(), columns=3)
    save_figure(figure, path)


def _draw_pool(axes: Axes, name: str, counts: Reliability) -> None:
    axes.fill_between([0, 1], [-0.1, 0.9], [0.1, 1.1], color=style.GRID, label="within 0.1")
    axes.plot([0, 1], [0, 1], color=style.FAINT)
    above = np.where(np.arange(BINS) >= round(SURELY_FREE * BINS), counts.cells, 0)
    enough = counts.cells > LEAST_SHARE * above.sum()
    readings = {"hold a surface": counts.share_holding, "or touch one": counts.share_touching}
    for (label, share), color in zip(readings.items(), style.ROBOTS, strict=False):
        axes.plot(
            counts.mean_probability[enough], share[enough], "o-", color=color, label=label,
            markersize=4.0,
        )  # fmt: skip
    axes.set_xlim(0, 1)
    axes.set_ylim(0, 1)
    axes.set_aspect("equal")
    axes.set_xlabel("mean probability of a bin's cells")
    axes.set_ylabel("share of them that ...")
    axes.set_title(f"{name}: {counts.worst():.2f} off")


def markdown(found: dict[str, Reliability]) -> str:
    """The counts as tables."""
    lines = []
    for name, counts in found.items():
        lines += [
            f"\n{name}, {counts.worst():.2f} off, {counts.worst(touching=False):.2f} exactly\n"
        ]
        lines += ["| mean probability | cells | hold a surface | or touch one |"]
        lines += ["|---:|---:|---:|---:|"]
        for number in np.flatnonzero(counts.cells):
            figures = (counts.share_holding[number], counts.share_touching[number])
            shares = " | ".join(f"{share:.3f}" for share in figures)
            mean, cells = counts.mean_probability[number], counts.cells[number]
            lines.append(f"| {mean:.3f} | {cells} | {shares} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Print the counts, and draw them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("bench_output/reliability.png"))
    parser.add_argument("--seeds", nargs="+", type=int, default=SEEDS)
    parser.add_argument("--cache", type=Path, help="folder to keep cones and scores in")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--page", type=Path, help="page to put the counts and the diagrams into")
    arguments = parser.parse_args()
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    found = pooled(arguments.seeds, arguments.cache, arguments.jobs)
    table = markdown(found)
    print(table, end="")
    draw(found, arguments.output)
    if arguments.page is not None:
        caption = "Shares of cells that hold or touch a surface, by the probability they were given"
        table += f"\nSeeds: {', '.join(map(str, arguments.seeds))}.\n"
        put_with_picture(arguments.page, "reliability", table, caption, partial(draw, found))


if __name__ == "__main__":
    main()
