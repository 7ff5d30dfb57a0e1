"""Compilation of the loops that NumPy cannot express, by Numba.

Where there is no Numba, or NUMBA_DISABLE_JIT is set, as a debugger needs it, they run as the Python
that they are written in.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, cast

Function = TypeVar("Function", bound=Callable[..., Any])

try:
    import numba
    from numba.core.caching import FunctionCache, IndexDataCacheFile
    from numba.core.runtime.nrt import rtsys
except ImportError:
    IS_COMPILED = False
else:
    #: Whether functions are compiled.
    IS_COMPILED = not vars(numba.config)["DISABLE_JIT"]

#: How all functions are compiled.  Nobody calls one from C, and what C would call takes a tenth of
#: the compiler's time.  None touches an object of Python's: other threads, as that which receives
#: messages, run meanwhile.
OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": True,
    "nogil": True,
    "no_cfunc_wrapper": True,
}
#: What changes with the way in which functions are compiled.
_WAY = "\n".join(
    Path(__file__).with_name(name).read_text(encoding="utf-8")
    for name in ("compiled.py", "linked.py")
)
#: All functions whose machine code is kept on disk.
COMPILED: list[Any] = []


def compiled(function: Function) -> Function:
    """Compile a function of numbers and arrays when it is first called.

    The machine code is kept on disk, so that only the first run ever on a machine waits for
    the compiler; where there is no folder to keep it in, every run does.
    """
    if not IS_COMPILED:
        return function
    dispatcher = _stamped(numba.njit(**OPTIONS)(function))
    _keep(dispatcher)
    return cast("Function", dispatcher)


def compiled_within(function: Function) -> Function:
    """Compile a function that only compiled functions call: from Python it runs as Python.

    It has no machine code of its own, only as a part of that of its callers.  To take arguments
    apart for a call from Python, and to put results together, is as much code as many a function,
    most of all with named tuples of arrays; here it is left out.
    """
    if not IS_COMPILED:
        return function
    from usmap_ros.numerics.linked import Linked

    options = {"nopython": True, "no_cpython_wrapper": True, **OPTIONS}
    return cast("Function", _stamped(Linked(function, options)))


def inlined(function: Function) -> Function:
    """Let a small function, or one with one caller, be compiled into those that call it.

    A call hands over every array of a named tuple by itself, which takes longer than what the
    function does; and the compiler has less to do.
    """
    if not IS_COMPILED:
        return function
    return cast("Function", _stamped(numba.njit(inline="always", **OPTIONS)(function)))


def compiler_version() -> str:
    """Everything but the code that machine code depends on: Numba, processor, options."""
    from llvmlite import binding

    chosen = [vars(numba.config)[name] for name in ("CPU_NAME", "CPU_FEATURES", "OPT")]
    found = [binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()]
    return repr([numba.__version__, *map(str, chosen), *found])


def _stamped(dispatcher: Any) -> Any:
    """Note what changes with the file of a function and with those of all that it may call.

    All compiled functions that its module has imported count, for those that stand below it in its
    file may call them, too.
    """
    function = dispatcher.py_func
    known = [value for _, value in sorted(function.__globals__.items())]
    helpers = [helper.source_stamp for helper in known if hasattr(helper, "source_stamp")]
    text = Path(function.__code__.co_filename).read_text(encoding="utf-8")
    parts = [_WAY, text, *helpers]
    dispatcher.source_stamp = hashlib.sha256("\n".join(parts).encode()).hexdigest()
    return dispatcher


def _keep(dispatcher: Any) -> None:
    """Keep the machine code of a function on disk, where there is a folder for it."""
    # Numba's word for: neither the package's folder nor the user's cache can be written.
    with suppress(RuntimeError):
        try:
            dispatcher._cache = _cache(dispatcher)
        except (AttributeError, OSError):
            # Numba keeps its caches otherwise in this version; then they are as it makes them.
            dispatcher.enable_caching()
    COMPILED.append(dispatcher)


def _cache(dispatcher: Any) -> Any:
    """What keeps a function apart from what it was when it, or one that it may call, was another.

    Numba looks at the file of the function only, but the machine code has its helpers in it.  Old
    and new have files of their own, because Numba fails on what it kept of a class that is not
    where it was.
    """

    class Cache(FunctionCache):
        # Numba gives the methods of its caches no types.
        def __init__(self, function: Callable[..., Any]) -> None:
            super().__init__(function)  # type: ignore[no-untyped-call]
            name = f"{self._impl.filename_base}-{dispatcher.source_stamp[:8]}"
            kept_in: Any = IndexDataCacheFile
            self._cache_file = kept_in(self._cache_path, name, dispatcher.source_stamp)

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            # Numba would first learn all that it can compile, which takes longer than to load what
            # is compiled already; it learns it anyway as soon as there is something to compile.
            rtsys.initialize(target_context)
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]

    return Cache(dispatcher.py_func)
