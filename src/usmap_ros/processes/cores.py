"""How many cores a program takes."""

import os

#: What the libraries for linear algebra below NumPy read when they are loaded.
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


def keep_linear_algebra_to_one_core() -> None:
    """Let linear algebra run in the thread that asks for it, unless the user wants it otherwise.

    Our systems of equations are small, and whole pings are shared out among processes.  Threads
    for each of them only wait for one another: on two busy cores a ping of a room took 330 ms to
    reconstruct with them, and 10 ms without.  It has to be said before NumPy is imported.
    """
    for variable in THREAD_VARIABLES:
        os.environ.setdefault(variable, "1")


def available_cores() -> int:
    """Cores that this process may use."""
    # Not everywhere can a process be kept to some of the cores.
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
