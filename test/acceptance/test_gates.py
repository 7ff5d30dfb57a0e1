"""No change may map any of a few kinds of place much worse than they were mapped before."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"
NAMES = (
    "clutter", "rough_rooms", "smooth_rooms", "corridors", "mixed", "panes", "columns",
    "few_pings", "range_only", "first_echoes", "poses_off", "first_pings",
)  # fmt: skip


@pytest.fixture(scope="module")
def gates() -> Iterator[ModuleType]:
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module("gates")
    sys.path.remove(str(FOLDER))


@pytest.mark.parametrize("name", NAMES)
def test_a_place_is_mapped_as_well_as_before(gates: ModuleType, name: str) -> None:
    after = gates.measured(name)
    print(name, after)
    # If it is meant to be so: python benchmarks/gates.py --rewrite
    assert gates.worse(gates.stored()[name], after) == {}


def test_every_gate_is_stored_and_tested(gates: ModuleType) -> None:
    assert tuple(gates.GATES) == tuple(gates.stored()) == NAMES


@pytest.mark.parametrize(
    ("figure", "value", "fails"),
    [
        ("f1", 0.46, True),
        ("f1", 0.48, False),
        ("f1", 0.9, False),
        ("known", 0.46, True),
        ("recall", 0.46, True),
        ("leak", 0.54, True),
        ("leak", 0.0, False),
        ("lost", 0.54, True),
        ("lost", 0.52, False),
    ],
)
def test_a_gate_fails_where_a_figure_is_worse_by_more_than_003(
    gates: ModuleType, figure: str, value: float, fails: bool
) -> None:
    before = dict.fromkeys(gates.FIGURES, 0.5)
    assert bool(gates.worse(before, before | {figure: value})) is fails
