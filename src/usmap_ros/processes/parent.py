"""Processes that end with the one that started them, even if that is killed."""

import ctypes
import os
import signal
import sys

#: From <linux/prctl.h>: the signal that a process gets when its parent dies.
_PR_SET_PDEATHSIG = 1


def end_with_parent(parent: int, number: signal.Signals) -> None:
    """Have Linux send this process a signal when its parent dies; elsewhere nothing.

    Parameters
    ----------
    parent : int
        Its number, as the parent said it: it may be dead already.
    number : Signals
        What to send.
    """
    if sys.platform != "linux":
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:
        os.kill(os.getpid(), number)
