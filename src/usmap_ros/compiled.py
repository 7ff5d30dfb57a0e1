"""Compilation of the loops that NumPy cannot express, by Numba."""

from __future__ import annotations

from collections.abc import Callable
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
        return cast(
            "Function", numba.njit(cache=True, error_model="numpy", fastmath=True)(function)
        )
    except RuntimeError:
        # Numba's word for: neither the package's folder nor the user's cache can be written.
        return cast("Function", numba.njit(error_model="numpy", fastmath=True)(function))


def inlined(function: Function) -> Function:
    """Let a small function be compiled into those that call it.

    A call hands over every array of a named tuple by itself, which takes longer than what the
    function does.
    """
    return cast(
        "Function", numba.njit(inline="always", error_model="numpy", fastmath=True)(function)
    )
