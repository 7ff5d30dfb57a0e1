"""Compilation of all inner loops before they are needed, once on a machine.

Left alone, Numba compiles a loop when it is first called: bit by bit, in the process that maps, of
which the compiler then takes hundreds of megabytes for good, and in several processes at once the
same.  Here a session in small (`usmap_ros.runs.small_session`) is run in processes of its own, at
once on the cores there are; what they compile is kept on disk, where all others find it.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

from usmap_ros.numerics import compiled
from usmap_ros.numerics.compiled import IS_COMPILED
from usmap_ros.processes.cores import available_cores
from usmap_ros.processes.memory import look_for_garbage_rarely
from usmap_ros.processes.parent import end_with_parent
from usmap_ros.runs.small_session import ALL, SESSION

#: What is said of it.
ONCE = "Compiling the inner loops, once on this machine (about a minute)"
EACH_TIME = (
    "Compiling the inner loops (some two minutes), as at each start: no folder to keep them in can"
    " be written; NUMBA_CACHE_DIR can name one"
)
SLOW = "the inner loops run as Python, some eighty times slower"
#: Versions of each module whose machine code is kept; characters of what a compiler complains of.
VERSIONS_KEPT, MOST_SAID = 8, 300
#: Modules that parts load when they run, on whose sources machine code depends as well.
LOADED_LATER = ("usmap_ros.localisation.refine",)


def compile_if_needed(
    say: Callable[[str], None], parts: Mapping[str, Callable[[], None]] = SESSION
) -> None:
    """Compile what a session needs, unless that was done before; where it fails, run as Python.

    Parameters
    ----------
    say : callable
        Called with a line that says what takes so long, if anything does.
    parts : mapping
        What to compile, `SESSION` or `ALL`.
    """
    if not IS_COMPILED:
        say(f"{compiled.WHY_NOT}: {SLOW}")
        return
    folder = compiled.cache_folder()
    if folder is None:
        say(EACH_TIME)
        failure = next(filter(None, map(_failure, parts.values())), None)
    elif not _missing(parts, folder):
        return
    else:
        say(ONCE)
        with _one_at_a_time(folder):
            # While this process waited, another one may have done it.
            failure = _compile_apart(_missing(parts, folder))
    if failure:
        compiled.run_as_python(f"Numba {version('numba')} fails ({failure})")
        say(f"{compiled.WHY_NOT}: {SLOW}")


def _missing(parts: Iterable[str], folder: Path) -> dict[str, Path]:
    """Parts that are not in a folder, as new as the code, with the files that will say they are."""
    depends_on = [
        # Whatever else a program has loaded: a node finds what a command has compiled.
        *(str(compiled.folder_of(module)) for module in (__spec__.name, *LOADED_LATER)),
        # Numba has a folder for each that sources lie in, and files for each version of Python.
        *(__file__, str(sys.implementation.cache_tag), compiled.compiler_version()),
    ]
    state = hashlib.sha256("\n".join(depends_on).encode()).hexdigest()[:12]
    marks = {part: folder / f"{part}-{state}" for part in parts}
    return {part: mark for part, mark in marks.items() if not mark.exists()}


def _remove_old(folder: Path) -> None:
    """Keep the newest versions of what lies in a folder, that of each module and each mark."""
    versions: dict[str, list[Path]] = {}
    for path in sorted(folder.glob("*-*"), key=lambda path: path.stat().st_mtime, reverse=True):
        versions.setdefault(path.name.rpartition("-")[0], []).append(path)
    for old in (path for paths in versions.values() for path in paths[VERSIONS_KEPT:]):
        if old.is_dir():
            shutil.rmtree(old, ignore_errors=True)
        else:
            old.unlink(missing_ok=True)


@contextmanager
def _one_at_a_time(folder: Path) -> Iterator[None]:
    """Wait until no other process compiles: a fleet starts many nodes at once."""
    try:
        import fcntl
    except ImportError:  # On Windows each may do it.
        yield
        return
    with (folder / "lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _compile_apart(marks: Mapping[str, Path]) -> str | None:
    """Run parts in processes of their own, one more at once than there are cores.

    Else, on two cores, the last of three would have one of them for itself.

    Returns
    -------
    str, optional
        Why one failed; nothing is said of one that was stopped, what it lacks is compiled later.
    """
    command = [sys.executable, "-m", __spec__.name, str(os.getpid())]
    waiting, failure = list(marks), None
    running: dict[str, subprocess.Popen[str]] = {}
    try:
        while waiting or running:
            while waiting and len(running) <= available_cores():
                part = waiting.pop(0)
                started = subprocess.Popen([*command, part], stderr=subprocess.PIPE, text=True)
                running[part] = started
            part = next(iter(running))
            _, said = running[part].communicate()
            status = running.pop(part).returncode
            if status == 0:
                _remove_old(marks[part].parent)
                marks[part].touch()
            elif status > 0:
                failure = failure or said.strip() or f"exit status {status}"
    finally:
        for process in running.values():
            process.kill()
            process.wait()
    return failure


def _failure(part: Callable[[], None]) -> str | None:
    """Run a part; what went wrong, if anything did."""
    try:
        part()
    except Exception as error:  # What a compiler raises that cannot do it is not known beforehand.
        return " ".join(f"{type(error).__name__}: {error}".split())[:MOST_SAID]
    return None


def main(parent: str, name: str) -> None:
    """Run a part, as a process that ends with the one that started it."""
    end_with_parent(int(parent), signal.SIGKILL)
    # A terminal's Ctrl-C comes to all processes; one of them is to speak.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    look_for_garbage_rarely()
    sys.exit(_failure(ALL[name]))


if __name__ == "__main__":
    main(*sys.argv[1:])
