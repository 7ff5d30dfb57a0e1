"""Kept machine code is as new as what it was made of, and without Numba functions run as Python."""

import subprocess
import sys
from pathlib import Path

import pytest

from usmap_ros.numerics import compiled as compilation
from usmap_ros.numerics.compiled import IS_COMPILED

needs_compiler = pytest.mark.skipif(not IS_COMPILED, reason="nothing is compiled")

#: A package in small: the decorators as they are, and a function with helpers in two more files.
CALLER = """
from usmap_ros.numerics.compiled import compiled
from usmap_ros.link import link
@compiled
def caller(x):
    return 2 * link(x)
"""
LINK = """
from usmap_ros.numerics.compiled import {decorator}
from usmap_ros.helper import FACTOR, helper
@{decorator}
def link(x):
    return FACTOR * helper(x)
"""
HELPER = """
from usmap_ros.numerics.compiled import compiled_within
FACTOR = {factor}
@compiled_within
def helper(x):
    return x + {added}
"""
PROGRAM = "{first}; from usmap_ros.caller import caller; print(caller(1), {second})"
HITS = "sum(caller.stats.cache_hits.values())"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    package = tmp_path / "usmap_ros"
    (package / "numerics").mkdir(parents=True)
    for folder in (package, package / "numerics"):
        (folder / "__init__.py").touch()
    source = Path(compilation.__file__)
    (package / "numerics" / source.name).write_bytes(source.read_bytes())
    (package / "caller.py").write_text(CALLER)
    return package


def write(package: Path, *, factor: int = 1, added: int = 1, decorator: str = "inlined") -> None:
    (package / "link.py").write_text(LINK.format(decorator=decorator))
    (package / "helper.py").write_text(HELPER.format(factor=factor, added=added))


def run(package: Path, first: str = "pass", second: str = HITS, **environment: str) -> list[str]:
    """Words that the package in small prints, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-B", "-c", PROGRAM.format(first=first, second=second)],
        cwd=package.parent,
        env={"NUMBA_CACHE_DIR": str(package.parent / "kept"), **environment},
        text=True,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@needs_compiler
@pytest.mark.parametrize("decorator", ["compiled", "compiled_within", "inlined"])
def test_a_changed_helper_of_a_helper_is_compiled_anew(package: Path, decorator: str) -> None:
    write(package, decorator=decorator)
    assert run(package) == ["4", "0"]
    write(package, decorator=decorator, added=100)
    assert run(package) == ["202", "0"]
    write(package, decorator=decorator, factor=3)
    assert run(package) == ["12", "0"]
    # What was compiled of the older source is still there.
    write(package, decorator=decorator)
    assert run(package) == ["4", "1"]


@needs_compiler
def test_without_a_folder_to_keep_it_in_a_function_works(package: Path) -> None:
    write(package)
    (package.parent / "kept").touch()
    assert run(package) == ["4", "0"]


@needs_compiler
def test_what_others_compile_is_kept_where_they_want_it(package: Path) -> None:
    import numba

    write(package)
    second = "__import__('numba').config.CACHE_DIR"
    assert run(package, second=second) == ["4", str(package.parent / "kept")]
    assert vars(numba.config)["CACHE_DIR"] != str(compilation.folder_of(__name__))


@pytest.mark.parametrize(
    ("numba", "why"),
    [
        ("", "Numba is missing"),
        ("raise ImportError('Numba needs NumPy 2.9 or less')", "NumPy 2.9 or less"),
        ("raise AttributeError('no attribute: long')", "AttributeError: no attribute: long"),
        ("def njit(**options): raise TypeError('inline')", "TypeError: inline"),
    ],
    ids=["missing", "too old", "in pieces", "of another kind"],
)
def test_without_a_numba_that_works_functions_are_python(
    package: Path, numba: str, why: str
) -> None:
    write(package)
    if numba:
        (package.parent / "numba").mkdir()
        (package.parent / "numba/__init__.py").write_text(numba)
        (package.parent / "numba/extending.py").write_text("register_jitable = None")
        first = "import sys"
    else:
        first = "import sys; sys.modules['numba'] = None"
    reason = "sys.modules['usmap_ros.numerics.compiled'].WHY_NOT"
    assert why in " ".join(run(package, first, f"type(caller).__name__, {reason}"))


def test_a_debugger_needs_python(package: Path) -> None:
    write(package)
    assert run(package, second="type(caller).__name__", NUMBA_DISABLE_JIT="1") == ["4", "function"]


@needs_compiler
def test_what_cannot_be_compiled_runs_as_python_from_then_on(package: Path) -> None:
    """As where a new Numba does not know what an old one did."""
    (package / "link.py").write_text("def link(x):\n    return eval('x')\n")
    first = "import usmap_ros.caller, usmap_ros.numerics.compiled as c; c.run_as_python('Why not.')"
    second = "c.WHY_NOT, c.IS_COMPILED, __import__('os').environ['NUMBA_DISABLE_JIT']"
    assert run(package, first, second) == ["2", "Why", "not.", "False", "1"]
