"""What is kept of compiled functions is as new as what they call."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

import pytest

import usmap_ros.numerics.compiled
from usmap_ros.numerics.compiled import IS_COMPILED, compiled

HELPER = """
from usmap_ros.numerics.compiled import compiled
@compiled
def helper(x):
    return x + {}
"""
CALLER = """
from usmap_ros.numerics.compiled import compiled
from helper_of_kept import helper
@compiled
def caller(x):
    return below(x)
@compiled
def below(x):
    return 2 * helper(x)
"""
LINK = """
from usmap_ros.numerics.compiled import {decorator}
from helper_of_kept import helper
@{decorator}
def link(x):
    return helper(x)
"""
pytestmark = pytest.mark.skipif(not IS_COMPILED, reason="nothing is compiled")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    # What is compiled here is nobody else's business.
    monkeypatch.setattr(usmap_ros.numerics.compiled, "COMPILED", [])
    (tmp_path / "caller_of_kept.py").write_text(CALLER)
    return tmp_path


def imported(folder: Path, added: int) -> ModuleType:
    (folder / "helper_of_kept.py").write_text(HELPER.format(added))
    for name in ("helper_of_kept", "link_to_helper", "caller_of_kept"):
        sys.modules.pop(name, None)
    importlib.invalidate_caches()
    return importlib.import_module("caller_of_kept")


def stamp(module: ModuleType) -> str:
    return str(module.caller._cache._cache_file._source_stamp)


def test_a_changed_helper_makes_its_callers_stale(folder: Path) -> None:
    first, changed = stamp(imported(folder, 1)), stamp(imported(folder, 100))
    assert first != changed


@pytest.mark.parametrize("decorator", ["compiled_within", "inlined"])
def test_a_changed_helper_of_a_helper_makes_its_callers_stale(folder: Path, decorator: str) -> None:
    (folder / "link_to_helper.py").write_text(LINK.format(decorator=decorator))
    caller = CALLER.replace("helper_of_kept import helper", "link_to_helper import link as helper")
    (folder / "caller_of_kept.py").write_text(caller)
    first = imported(folder, 1)
    assert first.caller(1) == 4
    changed = imported(folder, 100)
    assert changed.caller(1) == 202
    assert stamp(first) != stamp(changed)


def test_a_class_may_move_to_another_module(folder: Path) -> None:
    """Numba's own index of what it kept could not be read any more."""
    point = "from typing import NamedTuple\nclass Point(NamedTuple):\n    x: float\n"
    for home, other in (("first_home", "second_home"), ("second_home", "first_home")):
        (folder / f"{home}.py").write_text(point)
        (folder / f"{other}.py").write_text("")
        (folder / "user_of_point.py").write_text(
            f"from {home} import Point\n" + HELPER.format(1).replace("x + 1", "x.x + 1")
        )
        for name in ("first_home", "second_home", "user_of_point"):
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        module = importlib.import_module("user_of_point")
        assert module.helper(module.Point(1.0)) == 2.0


def test_without_a_folder_to_keep_it_in_a_function_works(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba.core.caching import FunctionCache

    def no_folder(cache: FunctionCache, function: object) -> None:
        raise RuntimeError("cannot cache function: no locator available")

    def negative(x: int) -> int:
        return -x

    monkeypatch.setattr(FunctionCache, "__init__", no_folder)
    monkeypatch.setattr(usmap_ros.numerics.compiled, "COMPILED", [])
    assert compiled(negative)(-2) == 2
