"""Scenes of fixed seeds that no change may map worse, and how well they were mapped last.

The figures are in `test/acceptance/gates.json`, and `test/acceptance/test_gates.py` holds every
change to them.  A change that is better, or worse for a reason, writes them anew:

python benchmarks/gates.py [--rewrite] [--gates rough_rooms ...]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from score_tables import Case
from scores import results_of

from usmap_ros.io.atomic import write_atomically

STORED = Path(__file__).parent.parent / "test" / "acceptance" / "gates.json"
#: What is stored of a score, and whether more of it is better.
FIGURES = {"f1": True, "recall": True, "known": True, "leak": False, "lost": False}
#: By how much a figure may be worse.
TOLERANCE = 0.03
#: Cases by name; of several the means count.
GATES = {
    "clutter": (Case("clutter", "plain", 4711),),
    "rough_rooms": (Case("rough_rooms", "plain", 4712),),
    "smooth_rooms": (Case("smooth_rooms", "plain", 4713),),
    "corridors": (Case("corridors", "plain", 4714),),
    # A rough room beside a smooth one, each of which answers otherwise.
    "mixed": (Case("mixed", "plain", 4723),),
    # Walls of bricks, some of glass: through one of these a robot left.
    "panes": tuple(Case("panes", "100_pings", seed) for seed in (1032, 1047, 1105, 1120)),
    # Echoes of a round column stand alone, and on a line, and are no pane's.
    "columns": (Case("columns_rough", "plain", 971),),
    # Few poles can be heard by so few pings; a single one would decide.
    "few_pings": tuple(Case("poles", "few_pings", seed) for seed in range(4715, 4721)),
    "range_only": (Case("swarm", "ranges", 4721),),
    # Of sonars that report the first echo only, which smooth walls answer as mirrors do.
    "first_echoes": (Case("flat_smooth", "first_echoes", 4722),),
    # Whose poses are off by chance, which is smoothed by how robots move.
    "poses_off": (
        Case("flat_rough", "100_poses_off", 4723),
        Case("columns_smooth", "100_poses_off", 4724),
    ),
    # So early that no mirror is known: who calls free what is behind one leads a robot astray.
    "first_pings": (
        Case("columns_smooth", "few_pings", 921),
        Case("flat_smooth", "few_pings", 922),
    ),
}


def measured(name: str, cache: Path | None = None) -> dict[str, float]:
    """Figures of a gate at the default settings."""
    scores = [results_of(case, ["ours"], cache)[0].score for case in GATES[name]]
    return {
        figure: round(float(np.mean([getattr(score, figure) for score in scores])), 4)
        for figure in FIGURES
    }


def stored() -> dict[str, dict[str, float]]:
    """Figures of every gate, as they were last written."""
    figures: dict[str, dict[str, float]] = json.loads(STORED.read_text(encoding="utf-8"))
    return figures


def worse(before: dict[str, float], after: dict[str, float]) -> dict[str, str]:
    """Figures that are worse than they were by more than `TOLERANCE`, by name: before and after."""
    return {
        name: f"{before[name]:.3f} -> {after[name]:.3f}"
        for name, more_is_better in FIGURES.items()
        if (before[name] - after[name]) * (1 if more_is_better else -1) > TOLERANCE
    }


def main() -> None:
    """Measure gates, compare them with what is stored, and store them if asked to."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gates", nargs="+", choices=list(GATES), default=list(GATES))
    parser.add_argument("--rewrite", action="store_true", help="store what is measured")
    parser.add_argument("--cache", type=Path, help="folder to keep cones and scores in")
    arguments = parser.parse_args()
    figures = stored() if STORED.exists() else {}
    for name in arguments.gates:
        before, after = figures.get(name), measured(name, arguments.cache)
        shown = "  ".join(f"{figure} {value:.3f}" for figure, value in after.items())
        missed = {} if before is None else worse(before, after)
        print(f"{name:14} {shown}{'' if not missed else f'  worse: {missed}'}")
        figures[name] = after
    if arguments.rewrite:
        kept = {name: figures[name] for name in GATES if name in figures}
        write_atomically(STORED, (json.dumps(kept, indent=2) + "\n").encode())


if __name__ == "__main__":
    main()
