"""What becomes of memory that a program does not use any more."""

import atexit
import ctypes
import gc
import sys

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
