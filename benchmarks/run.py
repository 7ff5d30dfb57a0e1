"""Run all benchmarks, print tables, and write the numbers as JSON and as a page.

python benchmarks/run.py [-o bench_output] [--page docs/benchmarks.md]
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
from pathlib import Path
from typing import Any

from pages import put
from rich.console import Console
from rich.table import Table

HERE = Path(__file__).parent
# Read when NumPy is loaded, which the benchmarks do: what is measured is one core.
os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def main() -> None:
    """Run every benchmark in this folder that has a function ``run``."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("bench_output"))
    parser.add_argument("--page", type=Path, help="page in Markdown to write the numbers into")
    arguments = parser.parse_args()
    console = Console()
    results: dict[str, Any] = {}
    for path in sorted(HERE.glob("*.py")):
        if path.stem == "run":
            continue
        module = importlib.import_module(path.stem)
        if not hasattr(module, "run"):
            continue
        console.print(f"Running {path.stem}")
        results[path.stem] = module.run()
        console.print(table(path.stem, results[path.stem]))
    results["machine"] = machine()
    arguments.output.mkdir(parents=True, exist_ok=True)
    written = arguments.output / "benchmarks.json"
    written.write_text(json.dumps(results, indent=2) + "\n")
    console.print(f"{written}")
    if arguments.page is not None:
        put(arguments.page, "times", page(results))


def page(results: dict[str, dict[str, Any]]) -> str:
    """All numbers in Markdown; each benchmark's docstring says what it measures."""
    made_with = ", ".join(f"{name} {value}" for name, value in results["machine"].items())
    parts = [
        "\nMeasured by `make bench` on two cores of a shared virtual machine:\n"
        f"{made_with}.\nTimes differ from machine to machine, and grow with the load: at 10 and"
        " more, by a quarter to a half. Ratios of\none run differ much less.\n"
    ]
    for name, numbers in results.items():
        if name == "machine":
            continue
        summary, _, rest = (importlib.import_module(name).__doc__ or "").partition("\n\n")
        # A paragraph that shows how to call the benchmark is no part of what it measures.
        explained = "\n\n".join(p for p in rest.split("\n\n") if not p.startswith("python "))
        rows = "".join(
            f"| {key.replace('_', ' ')} | {shown(value)} |\n" for key, value in numbers.items()
        )
        parts.append(f"### {name}\n\n{summary}\n\n{explained}\n\n| | |\n|---|---|\n{rows}")
    return "\n".join(parts)


def shown(value: Any) -> str:
    """Three figures of a number."""
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def table(name: str, numbers: dict[str, Any]) -> Table:
    """Names and numbers in two columns."""
    result = Table("", "", title=name, title_justify="left", show_header=False)
    result.columns[1].justify = "right"
    for key, value in numbers.items():
        result.add_row(key.replace("_", " "), shown(value))
    return result


def machine() -> dict[str, str]:
    """What the numbers were measured with."""
    import numpy as np

    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "processor": platform.machine(),
        # Of the last quarter of an hour.
        "load": f"{os.getloadavg()[2]:.0f}",
    }


if __name__ == "__main__":
    main()
