"""The table of docs/paper.md from equations and figures to functions."""

import importlib
import re
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "paper.md").read_text(encoding="utf-8")
_, _, TABLE = PAGE.partition("## Where it is in the code")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in TABLE.partition("\n## ")[0].splitlines()
    if line.startswith("|") and "`" in line and "(`usmap_ros.…`)" not in line
]
NAMES = [name for row in ROWS for name in re.findall(r"`([a-z_]+\.[\w.]+)`", row[-1])]


def find(name):
    """Import what a dotted name in the table means."""
    parts = name.split(".")
    for count in range(len(parts), 0, -1):
        try:
            thing = importlib.import_module(".".join(["usmap_ros", *parts[:count]]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            thing = getattr(thing, part, None) or thing.__annotations__[part]
        return thing
    raise AssertionError(f"no module in {name}")


@pytest.mark.parametrize("name", NAMES)
def test_what_the_table_names_is_there(name):
    assert find(name) is not None


@pytest.mark.parametrize("what", ["(1)", "(2)", "(3)", *(f"figure {n}" for n in (1, 6))])
def test_every_equation_and_figure_is_in_the_table(what):
    assert any(what in row[0] for row in ROWS)
