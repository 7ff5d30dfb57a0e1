"""Tables of scores: a row for each scene and method, what the README shows, what is aimed at."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from methods import METHODS
from scenes import CONDITIONS
from targets import TARGETS

from usmap_ros.evaluation.reliability import Reliability
from usmap_ros.evaluation.scoring import Score

#: Columns of the table: heading, field of the score, digits.
COLUMNS = (
    ("F1", "f1", 2),
    ("recall", "recall", 2),
    ("known", "known", 2),
    ("where audible", "known_audible", 2),
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
    """What a method made of a case, what it took to fuse a ping, and what it knows if it could."""

    case: Case
    method: str
    score: Score
    reliability: Reliability
    ms_per_ping: float
    known_audible: float

    def figure(self, name: str) -> float:
        """One of `COLUMNS`."""
        return float(getattr(self if name == "known_audible" else self.score, name))


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
                values = np.array([result.figure(name) for result in seeds])
                row[name], row[f"{name}_std"] = float(values.mean()), float(values.std())
            counts = [result.reliability for result in seeds]
            row["ms_per_ping"] = float(np.mean([result.ms_per_ping for result in seeds]))
            row["off"] = sum(counts[1:], start=counts[0]).worst()
            rows.append(row)
    return rows


def markdown(rows: list[dict[str, Any]]) -> str:
    """The rows as a table."""
    headings = ["scene", "method", *(heading for heading, _, _ in COLUMNS), "off", "ms a ping"]
    lines = [f"| {' | '.join(headings)} |", "|---|---|" + "---:|" * (len(headings) - 2)]
    for row in rows:
        figures = [
            f"{row[name]:.{digits}f} ± {row[f'{name}_std']:.{digits}f}"
            for _, name, digits in COLUMNS
        ]
        ends = [f"{row['off']:.2f}", f"{row['ms_per_ping']:.1f}"]
        cells = [shown_scene(row), METHODS[row["method"]].shown, *figures, *ends]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def shown_scene(row: dict[str, Any]) -> str:
    """Scene and condition of a row in words."""
    scene = str(row["scene"]).replace("_", " ")
    return (
        scene if row["condition"] == "plain" else f"{scene}, {CONDITIONS[row['condition']].shown}"
    )


def readme_table(rows: list[dict[str, Any]]) -> str:
    """`SHOWN_COLUMNS` of ours beside range only."""
    columns = [column for column in COLUMNS if column[1] in SHOWN_COLUMNS]
    headings = " | ".join(heading for heading, _, _ in columns)
    lines = [
        f"| scene | {headings} | range only: {headings} |",
        "|---|" + "---:|" * (len(SHOWN_METHODS) * len(columns)),
    ]
    # What is not part of this repository cannot be measured everywhere.
    rows = [row for row in rows if row["scene"] != "sandbox"]
    for _, pair in groupby(rows, key=lambda row: (row["scene"], row["condition"])):
        by_method = {row["method"]: row for row in pair}
        figures = [
            f"{by_method[method][name]:.{digits}f}"
            for method in SHOWN_METHODS
            for _, name, digits in columns
        ]
        scene = shown_scene(by_method["ours"])
        lines.append(f"| {scene} | {' | '.join(figures)} |")
    lines += ["", seeds_of(rows)]
    return "\n".join(lines) + "\n"


def seeds_of(rows: list[dict[str, Any]]) -> str:
    """A sentence that says which seeds the rows are from."""
    seeds = sorted({seed for row in rows for seed in row["seeds"]})
    return f"Seeds: {', '.join(map(str, seeds))}."


def targets_table(rows: list[dict[str, Any]]) -> str:
    """Every target beside what methods reach, in bold where it is missed."""
    headings = ["scenes", "method", *(heading for heading, _, _ in COLUMNS), "ms a ping"]
    lines = [f"| {' | '.join(headings)} |", "|---|---|" + "---:|" * (len(headings) - 2)]
    for target in TARGETS:
        own = [row for row in rows if (row["scene"], row["condition"]) in target.cases]
        for method in dict.fromkeys(row["method"] for row in own):
            same = [row for row in own if row["method"] == method]
            cells = [target.shown, METHODS[method].shown]
            for _, name, digits in COLUMNS:
                value = float(np.mean([row[name] for row in same]))
                bound = target.bound(name)
                cells.append(f"{value:.{digits}f}" + (f" ({bound})" if bound else ""))
                if target.is_missed(name, value):
                    cells[-1] = f"**{cells[-1]}**"
            cells.append(f"{np.mean([row['ms_per_ping'] for row in same]):.1f}")
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def compared_table(rows: list[dict[str, Any]]) -> str:
    """F1 and known of ours in every scene, and by how much those of other methods differ."""
    methods = list(dict.fromkeys(row["method"] for row in rows))
    headings = [f"{METHODS[method].shown}: F1 | known" for method in methods]
    lines = [f"| scene | {' | '.join(headings)} |", "|---|" + "---:|" * (2 * len(methods))]
    for _, group in groupby(rows, key=lambda row: (row["scene"], row["condition"])):
        by_method = {row["method"]: row for row in group}
        ours = by_method.pop("ours")
        cells = [f"{ours[name]:.3f}" for name in ("f1", "known")]
        for row in by_method.values():
            cells += [f"{row[name] - ours[name]:+.3f}" for name in ("f1", "known")]
        lines.append(f"| {shown_scene(ours)} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"
