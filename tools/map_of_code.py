"""The rooms of the package, their size, and which of them import which.

python tools/map_of_code.py [src/usmap_ros]
"""

from __future__ import annotations

import ast
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "src" / "usmap_ros"


def modules_of(package: Path) -> dict[str, Path]:
    """Files of a package by the dotted names of their modules."""
    files = {}
    for path in sorted(package.rglob("*.py")):
        parts = [package.name, *path.relative_to(package).with_suffix("").parts]
        files[".".join(parts).removesuffix(".__init__")] = path
    return files


def imported(path: Path, modules: dict[str, Path]) -> Iterator[str]:
    """Every module that a file imports, at its top, in a function, or for the type checker."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                # A package that is asked for a module has only to find it.
                module = f"{node.module}.{alias.name}"
                yield module if module in modules else node.module


def main() -> None:
    """Print a line for each room, those at the bottom first, and the sums."""
    package = Path(sys.argv[1]) if len(sys.argv) > 1 else PACKAGE
    modules = modules_of(package)

    def room(module: str) -> str:
        # The package's own page of names, which points everywhere, is no room.
        return module.split(".")[1] if "." in module else ""

    files: dict[str, int] = defaultdict(int)
    lines: dict[str, int] = defaultdict(int)
    above: dict[str, set[str]] = defaultdict(set)
    for module, path in modules.items():
        files[room(module)] += 1
        lines[room(module)] += len(path.read_text(encoding="utf-8").splitlines())
        for other in imported(path, modules):
            if other in modules and room(other) not in ("", room(module)) and room(module):
                above[room(module)].add(room(other))
    for name in sorted(lines, key=lambda name: (len(above[name]), name)):
        shown = name or "(the names that it offers)"
        print(f"{shown:28}{files[name]:4} files {lines[name]:6} lines  imports",
              ", ".join(sorted(above[name])) or "nothing")  # fmt: skip
    arrows = sum(map(len, above.values()))
    sums = f"{len(modules)} files, {sum(lines.values())} lines"
    print(f"{len(lines) - 1} rooms, {arrows} arrows, {sums}")


if __name__ == "__main__":
    main()
