"""Compilation of all inner loops before they are needed, once on a machine.

Left alone, Numba compiles a loop when it is first called: bit by bit, in the process that maps, of
which the compiler then takes hundreds of megabytes for good, and in several processes at once the
same.  Here a session in small is run in processes of its own, at once on the cores there are; what
they compile is kept on disk, where all others find it.
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
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.evaluation.line_of_sight import pings_in_sight
from usmap_ros.mapping.joint.estimate import JointEstimate
from usmap_ros.mapping.joint.leave_one_out import kept_pings
from usmap_ros.mapping.joint.surfaces.surface_lines import surface_lines
from usmap_ros.mapping.joint.visibility.field import field_around
from usmap_ros.mapping.next_view import best_views, candidate_poses
from usmap_ros.mapping.robot_check.consistency import Consistency
from usmap_ros.numerics import compiled
from usmap_ros.numerics.compiled import IS_COMPILED
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone, encode_limits
from usmap_ros.pings.fields_of_view import PingViews
from usmap_ros.pings.trace import Encoding
from usmap_ros.processes.cores import available_cores
from usmap_ros.processes.memory import look_for_garbage_rarely
from usmap_ros.processes.parent import end_with_parent
from usmap_ros.runs.pipeline import Pipeline

#: What is said of it.
ONCE = "Compiling the inner loops, once on this machine (some 30 s)"
EACH_TIME = (
    "Compiling the inner loops (some 40 s), as at each start: no folder to keep them in can be"
    " written; NUMBA_CACHE_DIR can name one"
)
SLOW = "the inner loops run as Python, some eighty times slower"
#: Versions of each module whose machine code is kept; characters of what a compiler complains of.
VERSIONS_KEPT, MOST_SAID = 8, 300
#: Modules that parts load when they run, on whose sources machine code depends as well.
LOADED_LATER = ("usmap_ros.localisation.refine",)
#: Pings that are mapped.
PINGS = 10


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


def map_pings() -> None:
    """Map pings together, compare robots, and see what was in sight of them."""
    from usmap_ros.simulation.points import TRANSDUCER

    pipeline, cones = _mapped(TRANSDUCER)
    occupancy = pipeline.occupancy_map()
    pings_in_sight(occupancy.observed, occupancy.geometry, PingViews.of(cones))
    consistency = Consistency(pipeline.parameters.mapping)
    for ping, cone in enumerate(cones):
        consistency.add("one" if ping < PINGS // 2 else "other", cone)
    consistency.findings()


def find_free_space() -> None:
    """Ask what is free, before anything is known of what stands: what mapping does last."""
    from usmap_ros.simulation.points import TRANSDUCER

    parameters = MappingParameters()
    cones = [_cone_from(0.1 * number, TRANSDUCER) for number in range(PINGS)]
    pings = kept_pings({"": cones}, parameters).pings()
    field = field_around(pings.table, pings.rows, parameters.resolution_m)
    estimate = JointEstimate(pings.table, pings.rows, pings.weights, pings.echoes, field)
    estimate.free_space(estimate.walls())
    # Two objects are no wall.
    surface_lines(np.zeros((1, 9)), np.ones((1, 9), np.bool_), 2.0)


def plan_views() -> None:
    """Ask where to look next."""
    from usmap_ros.simulation.points import TRANSDUCER

    occupancy = _mapped(TRANSDUCER)[0].occupancy_map()
    best_views(occupancy, candidate_poses(occupancy), TRANSDUCER, 1)


def refine_odometry() -> None:
    """Correct the poses of a robot that drifts."""
    from usmap_ros.localisation.refine import refine_poses
    from usmap_ros.simulation.points import TRANSDUCER

    refine_poses([("/robot/echo", cone) for cone in _mapped(TRANSDUCER)[1]], insists=True)


#: What is compiled at the same time, by what has it compiled, each about as long: by the time that
#: `map_pings` gets to free space, it finds on disk what `find_free_space` has compiled.
SESSION: dict[str, Callable[[], None]] = {
    reconstruct_all_kinds.__name__: reconstruct_all_kinds,
    find_free_space.__name__: find_free_space,
    map_pings.__name__: map_pings,
}
#: The same with what is rarely needed.
ALL = {
    **SESSION,
    reconstruct_chirps.__name__: reconstruct_chirps,
    plan_views.__name__: plan_views,
    refine_odometry.__name__: refine_odometry,
}


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


def _mapped(transducer: Transducer) -> tuple[Pipeline, list[EchoCone]]:
    """A pipeline with a map of some cones, and these."""
    pipeline = Pipeline()
    cones = [_cone_from(0.1 * number, transducer) for number in range(PINGS)]
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
