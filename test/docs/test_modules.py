"""Lists of modules on pages have all of them, and no other."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "src" / "usmap_ros"
#: Modules, classes and functions that sources and pages refer to.
REFERENCES = sorted(
    {
        reference
        for path in [*PACKAGE.rglob("*.py"), *ROOT.glob("docs/*.md"), *ROOT.glob("*.md")]
        for reference in re.findall(r"`(usmap_ros(?:\.\w+)+)`", path.read_text("utf-8"))
    }
)
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


@pytest.mark.parametrize("reference", REFERENCES)
def test_what_a_text_refers_to_is_there(reference: str) -> None:
    _, *names = reference.split(".")
    place = PACKAGE
    while names and (place / names[0]).is_dir():
        place /= names.pop(0)
    module = place / (
        names.pop(0) if names and (place / f"{names[0]}.py").is_file() else "__init__"
    )
    text = module.with_suffix(".py").read_text(encoding="utf-8")
    assert all(re.search(rf"\b{name}\b", text) for name in names[:1])
