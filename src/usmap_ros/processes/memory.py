"""How much memory a program takes, and what becomes of what it does not use any more."""

import atexit
import ctypes
import gc
import sys
from pathlib import Path

#: New objects between one look and the next; Python's own 700 are a look every few modules.
NEW_OBJECTS = 50_000


def look_for_garbage_rarely() -> None:
    """Look for unused objects rarely while a program starts and works, and not when it ends.

    A program of ours is hundreds of thousands of objects of modules and of Numba, none of which
    becomes unused.  To look through them all takes a fifth of the time of a short map, most of it
    at the end, when all of them are to go anyway.
    """
    gc.set_threshold(NEW_OBJECTS)
    atexit.register(gc.freeze)


def give_back_memory() -> None:
    """Let the system have the memory that is not used any more.

    The C library of Linux keeps what is let go, in an arena for each thread, unless it happens to
    be the arena's end: after many maps, three times as much as is used.  Other libraries have no
    such call.
    """
    if sys.platform == "linux":
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def peak_memory_mb() -> float:
    """Largest memory that this process ever took, MB."""
    # On Linux getrusage starts from the memory of the process that started this one.
    status = Path("/proc/self/status")
    if status.is_file():
        for line in status.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    # Not on Windows, where nothing but this figure would be missing.
    try:
        import resource
    except ImportError:
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    # Bytes on macOS, kilobytes elsewhere.
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6
