"""Run all benchmarks, print a table, and write the numbers as JSON.

python benchmarks/run.py [-o bench_output]
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

HERE = Path(__file__).parent
# Read when NumPy is loaded, which the benchmarks do: what is measured is one core.
os.environ |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def main() -> None:
    """Run every benchmark in this folder that has a function ``run``."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("bench_output"))
    arguments = parser.parse_args()
    console = Console()
    results: dict[str, Any] = {"machine": machine()}
    for path in sorted(HERE.glob("*.py")):
        if path.stem == "run":
            continue
        module = importlib.import_module(path.stem)
        if not hasattr(module, "run"):
            continue
        console.print(f"Running {path.stem}")
        results[path.stem] = module.run()
        console.print(table(path.stem, results[path.stem]))
    arguments.output.mkdir(parents=True, exist_ok=True)
    written = arguments.output / "benchmarks.json"
    written.write_text(json.dumps(results, indent=2) + "\n")
    console.print(f"{written}")


def table(name: str, numbers: dict[str, Any]) -> Table:
    """Names and numbers in two columns."""
    result = Table("", "", title=name, title_justify="left", show_header=False)
    result.columns[1].justify = "right"
    for key, value in numbers.items():
        result.add_row(
            key.replace("_", " "), f"{value:.3g}" if isinstance(value, float) else str(value)
        )
    return result


def machine() -> dict[str, str]:
    """What the numbers were measured with."""
    import numpy as np

    return {
        "python": platform.python_version(),
        "numpy": np.__version__,
        "processor": platform.machine(),
    }


if __name__ == "__main__":
    main()
