"""Compilation of the loops that NumPy cannot express, by Numba."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

#: Whether functions are compiled; not so where NUMBA_DISABLE_JIT is set, as a debugger needs it.
IS_COMPILED = not vars(numba.config)["DISABLE_JIT"]


def compiled(function: Function) -> Function:
    """Compile a function of numbers and arrays when it is first called.

    The machine code is kept on disk, so that only the first run ever on a machine waits for
    the compiler; where there is no folder to keep it in, every run does.
    """
    try:
        kept = numba.njit(cache=True, error_model="numpy", fastmath=True)(function)
    except RuntimeError:
        # Numba's word for: neither the package's folder nor the user's cache can be written.
        return cast("Function", numba.njit(error_model="numpy", fastmath=True)(function))
    # Numba may keep its caches otherwise in another version; then they are as it makes them.
    with suppress(AttributeError, OSError):
        _renew_with_helpers(kept, function)
    return cast("Function", kept)


def inlined(function: Function) -> Function:
    """Let a small function be compiled into those that call it.

    A call hands over every array of a named tuple by itself, which takes longer than what the
    function does.
    """
    return cast(
        "Function", numba.njit(inline="always", error_model="numpy", fastmath=True)(function)
    )


def _renew_with_helpers(kept: Any, function: Callable[..., Any]) -> None:
    """Make what is kept of a function stale, too, when a function that it may call has changed.

    Numba looks at the file of the function only, but the machine code has its helpers in it.  All
    compiled functions that its module has imported count, for those that stand below it in its
    file may call them, too.
    """
    known = function.__globals__
    helpers = [known[name] for name in sorted(known) if hasattr(known[name], "py_func")]
    own = kept._cache._cache_file
    own._source_stamp = _digest([repr(own._source_stamp), *map(_stamp, helpers)])


def _stamp(helper: Any) -> str:
    """What changes with a compiled function and, where it is kept itself, with its own helpers."""
    file = getattr(helper._cache, "_cache_file", None)
    if file is not None:
        return str(file._source_stamp)
    return _digest([Path(helper.py_func.__code__.co_filename).read_text(encoding="utf-8")])


def _digest(parts: list[str]) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
