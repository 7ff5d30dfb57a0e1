"""Compiled functions that have machine code in those that call them only.

Numba optimises every function and turns it into machine code by itself, and does so again in each
function that calls it, and in those that call these.  Where nothing but compiled functions call
it, all but the last is in vain; in a chain of calls that is most of a compiler's time.  This module
needs Numba.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher

# Numba gives no types to most of what is called and extended here.
# mypy: disable-error-code="no-untyped-call, no-untyped-def, misc"


class _Draft(JITCodeLibrary):
    """What LLVM is told of a function and of those that it calls, as its callers take it over."""

    def finalize(self) -> None:
        for library in dict.fromkeys(self._linking_libraries):
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True


class _DraftCompiler(Compiler):
    """A compiler that ends where machine code would be made."""

    def __init__(self, typing: Any, target: Any, library: None, *signature_and_options: Any):
        _, _, flags, _ = signature_and_options
        flags.no_compile = True
        draft = _Draft(target.codegen(), "draft")
        super().__init__(typing, target, draft, *signature_and_options)


class Linked(CPUDispatcher):
    """A function for others to call; from Python it runs as Python.

    Parameters
    ----------
    function : callable
        A Python function of numbers and arrays.
    options : dict
        Of the compiler.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, targetoptions=options, pipeline_class=_DraftCompiler)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Run as Python."""
        return self.py_func(*arguments, **named)

    def add_overload(self, result: Any) -> None:
        """Take up what was compiled for some types."""
        # What has no address is known by its description instead.
        result = result._replace(entry_point=result.fndesc)
        self.overloads[tuple(result.signature.args)] = result
        self.targetctx.insert_user_function(result.fndesc, result.fndesc, [result.library])
