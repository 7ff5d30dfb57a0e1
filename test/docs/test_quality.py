"""The quality declaration has a row for all that REP-2004 asks, and claims what it shows."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "QUALITY_DECLARATION.md").read_text(encoding="utf-8")
#: REP-2004's chart: up to which level each of its requirements is one.
UP_TO = {
    **dict.fromkeys(("2.iii", "2.v", "3.ii", "4.ii", "4.iii.b", "4.iv.a", "4.iv.b"), 1),
    **dict.fromkeys(("1.iii", "1.vi", "2.ii", "3.i", "3.v", "4.i", "4.iii.a"), 2),
    **dict.fromkeys(("4.v.a", "4.v.b", "5.i", "5.iii", "7.i"), 2),
    **dict.fromkeys(("1.i", "1.ii", "1.iv", "1.v", "2.i", "2.iv", "3.v.a", "3.v.c", "6.i"), 3),
    **dict.fromkeys(("3.iii", "3.iv"), 4),
}
ROWS = {
    name: (levels, met)
    for name, levels, met in re.findall(r"^\| (\d[.\w]*) \|[^|]*\|([^|]*)\|([^|]*)\|$", PAGE, re.M)
}


def test_every_requirement_has_its_row() -> None:
    levels = {name: len(levels.split(",")) for name, (levels, _) in ROWS.items()}
    assert levels == UP_TO


def test_the_level_that_is_claimed_is_the_one_that_is_met() -> None:
    claimed = int(re.search(r"claim \*\*quality level (\d)\*\*", PAGE)[1])
    unmet = {UP_TO[name] for name, (_, met) in ROWS.items() if not met.strip().startswith("yes")}
    assert claimed == 1 + max(unmet, default=0)


def test_what_it_leads_to_is_there() -> None:
    for path in re.findall(r"\]\((?!https?:)([^)#]+)\)|`((?:test|src|docs|\.github)/[^`]*)`", PAGE):
        assert (ROOT / (path[0] or path[1])).exists(), path


def test_the_readme_states_copyright_authors_and_level() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert "QUALITY_DECLARATION.md" in readme
    assert re.search(r"Copyright \d{4}", readme)
