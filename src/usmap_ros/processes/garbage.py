"""How often a program looks for objects that nothing but themselves refers to."""

from __future__ import annotations

import atexit
import gc

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
