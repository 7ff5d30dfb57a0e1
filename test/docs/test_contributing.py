"""A newcomer finds what CONTRIBUTING says is there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
TABLE = PAGE.split("## Where things are")[1].split("\n## ")[0]


def test_every_file_in_the_table_exists() -> None:
    paths = re.findall(r"`((?:src|test|docs|msg_schemas)/[^`]*)`", TABLE)
    assert len(paths) >= 15
    for path in paths:
        assert (ROOT / path).exists(), path


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
        "CoSaMP's steps", "fusion method", "beam pattern", "default of a parameter",
        "node's parameter", "score", "keys of scenarios",
    ):  # fmt: skip
        assert question in TABLE, question
