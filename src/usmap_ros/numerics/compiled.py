"""Compilation of the loops that NumPy cannot express, by Numba's public functions alone.

Where there is no Numba, where there is one that cannot be used, or where NUMBA_DISABLE_JIT is set,
as a debugger needs it, they run as the Python that they are written in.
"""

import functools
import hashlib
import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])

#: How all functions are compiled.  None touches an object of Python's: other threads, as that which
#: receives messages, run meanwhile.
OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": True, "nogil": True}

#: Where Numba looks for linear algebra.
_BLAS = "scipy.linalg"

#: Why nothing is compiled, if so.
WHY_NOT = ""
try:
    import numba
    from numba.extending import register_jitable

    numba.njit(inline="always", **OPTIONS)(lambda: None)
    #: Numba's settings, those that have names of environment variables without NUMBA_.
    _SETTINGS = vars(numba.config)
    if _SETTINGS["DISABLE_JIT"]:
        WHY_NOT = "Numba is switched off"
except ImportError as error:
    WHY_NOT = f"Numba is missing ({error})" if error.name != "numba" else "Numba is missing"
except Exception as error:  # Versions that do not fit together raise what they like.
    WHY_NOT = f"Numba cannot be used ({type(error).__name__}: {error})"

#: Whether functions are compiled.
IS_COMPILED = not WHY_NOT


def compiled(function: Function) -> Function:
    """Compile a function of numbers and arrays when it is first called.

    The machine code is kept on disk, so that only the first run ever on a machine waits for
    the compiler; where there is no folder to keep it in, every run does.
    """
    if not IS_COMPILED:
        return function
    folder = folder_of(function.__module__)
    with _cached_in(folder):
        return cast("Function", numba.njit(cache=folder is not None, **OPTIONS)(function))


def compiled_within(function: Function) -> Function:
    """Compile a function that only compiled functions call: from Python it runs as Python.

    Its machine code is kept as a part of that of its callers.
    """
    if not IS_COMPILED:
        return function
    return register_jitable(**OPTIONS)(function)


def inlined(function: Function) -> Function:
    """Let a small function, or one with one caller, be compiled into those that call it.

    A call hands over every array of a named tuple by itself, which takes longer than what the
    function does; and the compiler has less to do.
    """
    if not IS_COMPILED:
        return function
    return cast("Function", numba.njit(inline="always", **OPTIONS)(function))


def run_as_python(why: str) -> None:
    """Let everything run as Python from now on, in this process and in those that it starts."""
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    instead: dict[str, Any] = {"IS_COMPILED": False, "WHY_NOT": why}
    for name, module in list(sys.modules.items()):
        if name.startswith("usmap_ros."):
            for key, value in list(vars(module).items()):
                setattr(module, key, instead.get(key, getattr(value, "py_func", value)))


def compiler_version() -> str:
    """Everything but the code that machine code depends on: Numba, processor, options."""
    from llvmlite import binding

    chosen = [_SETTINGS[name] for name in ("CPU_NAME", "CPU_FEATURES", "OPT")]
    found = [binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()]
    return repr([numba.__version__, *map(str, chosen), *found])


@functools.cache
def cache_folder() -> Path | None:
    """Folder for machine code: in NUMBA_CACHE_DIR, or the user's; None if it cannot be written."""
    users = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folder = Path(_SETTINGS["CACHE_DIR"] or users, "usmap_ros")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def folder_of(module: str) -> Path | None:
    """Folder for the machine code of a module, as it and all that it imports are now.

    Numba looks at the file of a function alone, but the machine code has in it what was imported,
    too: helpers and constants.
    """
    folder = cache_folder()
    return folder and folder / f"{module}-{_digest(module)}"


def _digest(module: str) -> str:
    """Digest of the source of a module and of those of all that it imports, directly or not."""
    begin = _file_of(module) or Path(sys.modules[module].__file__ or "")
    digests: dict[Path, str] = {}
    waiting = {begin}
    while waiting:
        path = waiting.pop()
        digests[path], imported = _source(path)
        waiting |= imported - digests.keys()
    return hashlib.sha256("".join(sorted(digests.values())).encode()).hexdigest()[:12]


@functools.cache
def _source(path: Path) -> tuple[str, set[Path]]:
    """Digest of a source, and the sources of this package that it imports where it begins."""
    text = path.read_text(encoding="utf-8")
    imports = re.findall(r"^from (usmap_ros[\w.]*) import (\w+)?", text, re.MULTILINE)
    files = (_file_of(f"{module}.{name}") or _file_of(module) for module, name in imports)
    return hashlib.sha256(text.encode()).hexdigest(), {file for file in files if file}


@functools.cache
def _file_of(module: str) -> Path | None:
    """Source of a module of this package."""
    path = Path(__file__).parents[2].joinpath(*module.split("."))
    found = (file for file in (path.with_suffix(".py"), path / "__init__.py") if file.is_file())
    return next(found, None)


@contextmanager
def _cached_in(folder: Path | None) -> Iterator[None]:
    """Let Numba keep in a folder what is declared meanwhile."""
    before = _SETTINGS["CACHE_DIR"]
    _SETTINGS["CACHE_DIR"] = str(folder or before)
    try:
        yield
    finally:
        _SETTINGS["CACHE_DIR"] = before


@compiled
def _nothing() -> None:
    """What takes least to compile."""


def begin_without_blas() -> None:
    """Let Numba make ready to take machine code from disk, without SciPy's linear algebra.

    None of our loops calls that, and to load it takes as long as all else.  Functions that a
    program compiles for itself could not call it afterwards: this is for commands.
    """
    modules = cast("dict[str, Any]", sys.modules)
    if IS_COMPILED and _BLAS not in modules:
        modules[_BLAS] = None
        try:
            _nothing()
        finally:
            del modules[_BLAS]
