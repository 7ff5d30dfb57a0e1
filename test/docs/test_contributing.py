"""A newcomer finds what CONTRIBUTING says is there."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def section(heading: str) -> str:
    """A part of the page."""
    return PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]


TABLE = section("Where things are")
WORDS = dict(re.findall(r"^\| ([^|`]+) \| `([^`|]+)` \|$", section("The field's words"), re.M))


def test_every_file_in_the_table_exists() -> None:
    paths = re.findall(r"`((?:src|test|docs|msg_schemas)/[^`]*)`", TABLE)
    assert len(paths) >= 15
    for path in paths:
        assert (ROOT / path).exists(), path


@pytest.mark.parametrize("words", WORDS)
def test_each_word_of_the_field_has_one_file_that_says_it(words: str) -> None:
    assert (ROOT / WORDS[words]).is_file()


def test_the_words_that_everybody_looks_for_are_there() -> None:
    for word in (
        "inverse sensor model", "forward model", "ray casting", "free space", "log-odds update",
        "explaining away", "CoSaMP's steps", "matched filter", "beam pattern", "multipath",
    ):  # fmt: skip
        assert any(word in words for words in WORDS), word


def test_every_name_in_the_table_is_in_a_file_beside_it() -> None:
    for name in ("SolverName", "FUSIONS", "BeamModel", "PulseModel"):
        (row,) = [row for row in TABLE.splitlines() if f"`{name}`" in row]
        files = [ROOT / path for path in re.findall(r"`(src/[^`]*\.py)`", row)]
        assert any(name in file.read_text(encoding="utf-8") for file in files), name


def test_steps_of_cosamp_have_the_names_of_the_table() -> None:
    source = (ROOT / "src/usmap_ros/reconstruction/cosamp.py").read_text(encoding="utf-8")
    for step in ("proxy", "identification", "support_merger", "least_squares", "pruning"):
        assert re.search(rf"^def \w*{step}\(", source, flags=re.MULTILINE), step


def test_the_questions_of_newcomers_have_a_row() -> None:
    for question in (
        "fusion method", "beam pattern", "default of a parameter",
        "node's parameter", "score", "keys of scenarios",
    ):  # fmt: skip
        assert question in TABLE, question
