"""Compilation of all inner loops before they are needed, once on a machine.

Left alone, Numba compiles a loop when it is first called: bit by bit, in the process that maps, of
which the compiler then takes hundreds of megabytes for good, and in several processes at once the
same.  Here a session in small is run in processes of its own, at once on the cores there are; what
they compile is kept on disk, where all others find it.
"""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.mapping.next_view import best_views, candidate_poses
from usmap_ros.numerics.compiled import COMPILED, IS_COMPILED, compiler_version
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone, encode_limits
from usmap_ros.pings.trace import Encoding
from usmap_ros.processes.garbage import look_for_garbage_rarely
from usmap_ros.processes.parent import end_with_parent
from usmap_ros.runs.parallel import available_cores
from usmap_ros.runs.pipeline import Pipeline

#: What is said of it.
ONCE = "Compiling the inner loops, once on this machine (some 30 s)"
EACH_TIME = (
    "Compiling the inner loops (some 60 s), as at each start: no folder to keep them in can be"
    " written; NUMBA_CACHE_DIR can name one"
)
SLOW = "Numba is missing or switched off: the inner loops run as Python, some eighty times slower"


def reconstruct_all_kinds() -> None:
    """Reconstruct a ping of each encoding, and one with several paths to each object."""
    # Here, because none but the processes that compile need a simulator.
    from usmap_ros.simulation.points import AIR, RECEIVER, hear

    pipeline = Pipeline()
    raw = replace(RECEIVER, encoding=Encoding.RAW, sample_rate_hz=250_000.0)
    envelope = replace(RECEIVER, encoding=Encoding.ENVELOPE)
    floor = Channel(343.0, floor_height_m=0.3, floor_reflectivity=0.5)
    for receiver, channel in ((RECEIVER, AIR), (RECEIVER, floor), (envelope, AIR), (raw, AIR)):
        pipeline.reconstruct(hear([(1.5, 0.2), (2.5, -0.3)], receiver=receiver, channel=channel))


def reconstruct_chirps() -> None:
    """Reconstruct a ping whose pulse is complex, for which all is compiled once more."""
    from usmap_ros.simulation.points import TRANSDUCER, hear

    chirp = Pulse(PulseShape.CHIRP, 50_000.0, 0.001, sweep_hz=5_000.0)
    Pipeline().reconstruct(hear([(1.5, 0.2)], transducer=replace(TRANSDUCER, pulse=chirp)))


def map_all_ways() -> None:
    """Map few pings and many, and compare robots."""
    from usmap_ros.simulation.points import TRANSDUCER

    pipeline, cones = _mapped(TRANSDUCER)
    by_others = pipeline.fusion.by_others()
    assert by_others is not None
    by_others.expected({"one": cones[:5], "other": cones[5:]})


def plan_views() -> None:
    """Ask where to look next."""
    from usmap_ros.simulation.points import TRANSDUCER

    occupancy = _mapped(TRANSDUCER)[0].occupancy_map()
    best_views(occupancy, candidate_poses(occupancy), TRANSDUCER, 1)


#: What is compiled at the same time, by what has it compiled: what takes longest first.
SESSION: dict[str, Callable[[], None]] = {
    reconstruct_all_kinds.__name__: reconstruct_all_kinds,
    map_all_ways.__name__: map_all_ways,
}
#: The same with what few need.
ALL = {
    **SESSION,
    reconstruct_chirps.__name__: reconstruct_chirps,
    plan_views.__name__: plan_views,
}


def compile_if_needed(
    say: Callable[[str], None], parts: Mapping[str, Callable[[], None]] = SESSION
) -> None:
    """Compile what a session needs, unless that was done before.

    Parameters
    ----------
    say : callable
        Called with a line that says what takes so long, if anything does.
    parts : mapping
        What to compile, `SESSION` or `ALL`.
    """
    if not IS_COMPILED:
        say(SLOW)
        return
    folders = _folders()
    if folders is None:
        say(EACH_TIME)
        for part in parts.values():
            part()
        return
    if not _missing(parts, folders):
        return
    say(ONCE)
    with _one_at_a_time(folders[0]):
        # While this process waited, another one may have done it.
        missing = _missing(parts, folders)
        _remove_outdated(folders)
        if _compile_apart(missing):
            for mark in (mark for part in missing for mark in _marks(part, folders)):
                mark.write_text(_state(), encoding="ascii")


def _own() -> list[Any]:
    """The package's compiled functions: those that others may have compiled are their business."""
    home = str(Path(__file__).parents[1]) + os.sep
    return [function for function in COMPILED if _file_of(function).startswith(home)]


def _file_of(function: Any) -> str:
    return str(function.py_func.__code__.co_filename)


def _folders() -> list[Path] | None:
    """Folders in which compiled functions are kept; None if some are not."""
    paths = {function._cache.cache_path for function in _own()}
    return None if None in paths else sorted(map(Path, paths))


def _missing(parts: Iterable[str], folders: list[Path]) -> list[str]:
    """Parts that are not on disk, as new as the code, for this compiler and processor."""
    state = _state()

    def is_there(mark: Path) -> bool:
        return mark.is_file() and mark.read_text(encoding="ascii") == state

    return [part for part in parts if not all(map(is_there, _marks(part, folders)))]


def _remove_outdated(folders: list[Path]) -> None:
    """Remove machine code of functions as they are no more, for this version of Python."""
    kept = {Path(function._cache._cache_file._index_name).stem for function in _own()}
    version = f".py{sys.version_info.major}{sys.version_info.minor}"
    for folder in folders:
        for file in folder.glob(f"*{version}*.nb[ic]"):
            # Machine code has a number behind the name of its index.
            name = file.stem if file.suffix == ".nbi" else Path(file.stem).stem
            if name not in kept:
                file.unlink(missing_ok=True)


def _marks(part: str, folders: list[Path]) -> list[Path]:
    """Files that say that a part was compiled; one in each folder, for who deletes that."""
    machine = hashlib.sha256(compiler_version().encode()).hexdigest()[:8]
    name = f"usmap-{part}.{sys.implementation.cache_tag}-{machine}.compiled"
    return [folder / name for folder in folders]


def _state() -> str:
    """What functions are compiled from, as it is now: by the same token as they are kept by."""
    parts = [Path(__file__).read_text(encoding="utf-8")]
    parts += sorted(function.source_stamp for function in _own())
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@contextmanager
def _one_at_a_time(folder: Path) -> Iterator[None]:
    """Wait until no other process compiles: a fleet starts many nodes at once."""
    try:
        import fcntl
    except ImportError:  # On Windows each may do it.
        yield
        return
    with (folder / "usmap.lock").open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _compile_apart(names: list[str]) -> bool:
    """Run parts in processes of their own, as many at once as there are cores; whether all did."""
    command = [sys.executable, "-m", __spec__.name, str(os.getpid())]
    waiting, succeeded = list(names), True
    running: list[subprocess.Popen[bytes]] = []
    try:
        while waiting or running:
            while waiting and len(running) < available_cores():
                running.append(subprocess.Popen([*command, waiting.pop(0)]))
            succeeded &= running[0].wait() == 0
            del running[0]
    finally:
        for process in running:
            process.kill()
            process.wait()
    return succeeded


def main(parent: str, name: str) -> None:
    """Run a part, as a process that ends with the one that started it."""
    end_with_parent(int(parent), signal.SIGKILL)
    # A terminal's Ctrl-C comes to all processes; one of them is to speak.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    look_for_garbage_rarely()
    ALL[name]()


def _mapped(transducer: Transducer) -> tuple[Pipeline, list[EchoCone]]:
    """A pipeline with a map of some cones, and these."""
    pipeline = Pipeline()
    cones = [_cone_from(0.1 * number, transducer) for number in range(10)]
    for cone in cones:
        pipeline.fuse(cone)
    return pipeline, cones


def _cone_from(x_m: float, transducer: Transducer) -> EchoCone:
    """What a transducer hears of two objects, without reconstruction."""
    ranges_m = np.sort(np.hypot(np.array([1.5, 2.5]) - x_m, [0.2, -0.3]))
    amplitudes = ranges_m**-2.0
    as_message = np.float32
    return EchoCone(
        stamp_ns=round(1e9 * x_m),
        frame_id="map",
        child_frame_id="sonar",
        pose=Pose.planar(x_m, 0.0, 0.0),
        transducer=transducer,
        attenuation_db_m=0.0,
        ranges_m=ranges_m.astype(as_message),
        range_stds_m=np.full(2, 1e-4, as_message),
        amplitudes=amplitudes.astype(as_message),
        amplitude_stds=(0.02 * amplitudes).astype(as_message),
        limit_step_m=0.02,
        detection_limits=encode_limits(np.full(240, 0.02)),
        residual=0.1,
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
