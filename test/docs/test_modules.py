"""Lists of modules on pages have all of them, and no other."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "usmap_ros"
#: Pages with a table of all modules of a package, under a heading that names it.
TABLES = [
    (page.name, package, table)
    for page in sorted(ROOT.glob("docs/*.md"))
    for package, table in re.findall(
        r"^\| step \| module of `([\w.]+)` \|\n\|[-|]+\|\n((?:\|.*\n)+)",
        page.read_text("utf-8"),
        re.M,
    )
]


def test_there_is_such_a_table() -> None:
    assert TABLES


@pytest.mark.parametrize(("page", "package", "table"), TABLES, ids=lambda part: part.split("\n")[0])
def test_a_table_of_modules_has_all_of_them(page: str, package: str, table: str) -> None:
    folder = PACKAGE / package.replace(".", "/")
    modules = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    named = {name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row)}
    assert named == modules


def test_the_steps_of_reconstruction_have_modules() -> None:
    text = (ROOT / "docs" / "reconstruction.md").read_text(encoding="utf-8")
    steps = re.findall(r"^\d\. .*\((.*`)[^`]*\)$", text, re.M)
    named = {name for step in steps for name in re.findall(r"`(\w+)`", step)}
    assert len(named) >= 5
    modules = {path.stem for path in PACKAGE.rglob("*.py")}
    assert named <= modules | {"chirp_sweep_hz"}
