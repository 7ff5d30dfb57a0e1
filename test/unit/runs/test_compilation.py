"""What a session needs is compiled beforehand, once, and not in the process that maps."""

import json
import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import yaml

from usmap_ros import numerics
from usmap_ros.grids import OCCUPIED_PROBABILITY
from usmap_ros.io.map_files import load_map
from usmap_ros.numerics.compiled import IS_COMPILED
from usmap_ros.runs import compilation
from usmap_ros.runs.compilation import (
    EACH_TIME,
    LOADED_LATER,
    ONCE,
    SLOW,
    compile_if_needed,
)
from usmap_ros.runs.small_session import ALL, SESSION

SOURCE = Path(compilation.__file__).parents[1]
needs_compiler = pytest.mark.skipif(not IS_COMPILED, reason="nothing is compiled")

#: Runs the command line, and says which functions were compiled in its own process.
PROGRAM = """
import json, sys
from numba.core import event
from usmap_ros.cli import main

class Listener(event.Listener):
    names = []
    def on_start(self, started):
        self.names.append(started.data["dispatcher"].py_func.__qualname__)
    def on_end(self, ended):
        pass

event.register("numba:compile", Listener())
try:
    main()
finally:
    print(json.dumps(Listener.names))
"""
SCENARIO = """\
seed: 3
duration_s: {duration_s}
world:
  points: [{{x_m: 2.0, y_m: 0.4, reflectivity: 1.0}}, {{x_m: 1.5, y_m: -0.6, reflectivity: 0.8}}]
robots:
  - name: robot1
    motion: {{kind: waypoints, waypoints_m: [[0.0, -1.0], [0.0, 1.0]], speed_m_s: 1.0}}
    transducers:
      - mount: {{yaw_rad: -1.2}}
        max_range_m: 3.0
        receiver: {{encoding: {encoding}, sample_rate_hz: {rate_hz}, noise_std: 0.01}}
  - name: robot2
    motion: {{kind: waypoints, waypoints_m: [[0.1, 1.0], [0.1, -1.0]], speed_m_s: 1.0}}
    transducers:
      - mount: {{yaw_rad: 1.2}}
        max_range_m: 3.0
        receiver: {{encoding: {encoding}, sample_rate_hz: {rate_hz}, noise_std: 0.01}}
"""


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[list[str]]:
    """Give the parts that were compiled, call by call; nothing is, and marks go to a folder."""
    compiled: list[list[str]] = []

    def compile_apart(marks: dict[str, Path]) -> None:
        compiled.append(list(marks))
        for mark in marks.values():
            mark.touch()

    monkeypatch.setattr(compilation, "_compile_apart", compile_apart)
    monkeypatch.setattr(numerics.compiled, "cache_folder", lambda: tmp_path)
    return compiled


@needs_compiler
def test_it_is_done_once_and_said(calls: list[list[str]]) -> None:
    said: list[str] = []
    for _ in range(2):
        compile_if_needed(said.append)
    assert said == [ONCE]
    assert calls == [list(SESSION)]
    compile_if_needed(said.append, ALL)
    assert calls[1:] == [[name for name in ALL if name not in SESSION]]


@needs_compiler
def test_it_is_done_again_when_code_or_processor_change(
    calls: list[list[str]], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    compile_if_needed(lambda line: None)
    monkeypatch.setattr(numerics.compiled, "compiler_version", lambda: "of another processor")
    compile_if_needed(lambda line: None)
    monkeypatch.setattr(numerics.compiled, "folder_of", lambda name: tmp_path / f"{name}-other")
    compile_if_needed(lambda line: None)
    assert calls == 3 * [list(SESSION)]


def test_of_old_versions_the_newest_are_kept(tmp_path: Path) -> None:
    for number in range(12):
        folder = tmp_path / f"usmap_ros.one-{number:012x}"
        folder.mkdir()
        (folder / "machine_code").touch()
        os.utime(folder, (number, number))
    (tmp_path / "usmap_ros.other-0").touch()
    compilation._remove_old(tmp_path)
    left = sorted(path.name for path in tmp_path.iterdir())
    newest = [f"usmap_ros.one-{number:012x}" for number in range(4, 12)]
    assert left == [*newest, "usmap_ros.other-0"]


@needs_compiler
def test_what_one_program_has_compiled_all_others_find(tmp_path: Path) -> None:
    """A node loads more modules with compiled loops than a command, and compiled all anew."""
    program = """
from usmap_ros.runs import compilation
compilation._compile_apart = lambda marks: [mark.touch() for mark in marks.values()] and None
compilation.compile_if_needed(print)
"""
    said = [
        subprocess.run(
            [sys.executable, "-c", imports + program],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
            capture_output=True, text=True, check=True,
        ).stdout.strip()
        for imports in ("", "import usmap_ros.localisation.refine")
    ]  # fmt: skip
    assert said == [ONCE, ""]


@needs_compiler
def test_without_a_folder_it_is_done_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    said, done = list[str](), list[bool]()
    monkeypatch.setattr(numerics.compiled, "cache_folder", lambda: None)
    compile_if_needed(said.append, {"part": lambda: done.append(True)})
    assert (said, done) == ([EACH_TIME], [True])


def test_without_a_compiler_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(compilation, "IS_COMPILED", False)
    monkeypatch.setattr(numerics.compiled, "WHY_NOT", "Numba is missing")
    compile_if_needed(said.append)
    assert said == [f"Numba is missing: {SLOW}"]


class Process:
    """A process that ends as it is told to."""

    commands: list[list[str]]
    ends: dict[str, tuple[int, str]]

    def __init__(self, command: list[str], **options: object) -> None:
        self.commands.append(command)
        self.returncode, self._said = self.ends.get(command[-1], (0, ""))

    def communicate(self) -> tuple[None, str]:
        return None, self._said


@needs_compiler
def test_a_part_runs_in_a_process_of_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(subprocess, "Popen", Process)
    monkeypatch.setattr(Process, "commands", [], raising=False)
    ends = {"stopped": (-9, ""), "failed": (1, "LoweringError: no.\n")}
    monkeypatch.setattr(Process, "ends", ends, raising=False)
    marks = {name: tmp_path / name for name in ("one", "stopped", "other")}
    assert compilation._compile_apart(marks) is None
    start = [sys.executable, "-m", "usmap_ros.runs.compilation", str(os.getpid())]
    assert Process.commands == [[*start, name] for name in marks]
    assert compilation._compile_apart({"failed": tmp_path / "failed"}) == "LoweringError: no."
    # What did not end well is not marked as done.
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one", "other"]


@needs_compiler
def test_what_cannot_be_compiled_runs_as_python(
    calls: list[list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    said, why = list[str](), list[str]()
    monkeypatch.setattr(compilation, "_compile_apart", lambda marks: "LoweringError: no.")
    monkeypatch.setattr(numerics.compiled, "run_as_python", why.append)
    compile_if_needed(said.append)
    assert why == [f"Numba {version('numba')} fails (LoweringError: no.)"]
    assert said == [ONCE, f"{numerics.compiled.WHY_NOT}: {SLOW}"]


def test_everything_that_is_compiled_is_known() -> None:
    """Whether machine code is new enough is asked of what these modules import."""
    modules = (compilation.__name__, *LOADED_LATER)
    program = f"import sys, {', '.join(modules)}; print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    ).stdout.split()
    decorated = {
        ".".join(path.relative_to(SOURCE.parent).with_suffix("").parts)
        for path in SOURCE.rglob("*.py")
        if re.search(r"^@compiled$", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert len(decorated) > 10
    assert decorated <= set(loaded)


@needs_compiler
def test_a_session_in_small_runs_every_loop() -> None:
    """What it missed was compiled by the first map that needed it, for seconds and in silence."""
    compile_if_needed(lambda line: None, ALL)
    loops = {
        (".".join(path.relative_to(SOURCE.parent).with_suffix("").parts), name)
        for path in SOURCE.rglob("*.py")
        for name in re.findall(r"^@compiled\ndef (\w+)", path.read_text(encoding="utf-8"), re.M)
    }
    program = f"""
import importlib
from usmap_ros.runs.small_session import ALL
for part in ALL.values():
    part()
for module, name in {sorted(loops)}:
    loop = getattr(importlib.import_module(module), name)
    if not loop.signatures:
        print(module, name)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert len(loops) > 40
    # Numba's own functions are looked up by compiling it.
    assert done.stdout.splitlines() == ["usmap_ros.numerics.compiled _nothing"]


@needs_compiler
def test_a_session_has_complex_pulses_too() -> None:
    """Any map by a pulse that was learnt compiled its search anew, for half a minute in silence."""
    compile_if_needed(lambda line: None)
    program = """
from usmap_ros.reconstruction.sampled.search import search
from usmap_ros.runs.small_session import SESSION
for name, part in SESSION.items():
    if name.startswith("reconstruct"):
        part()
print(*{str(arguments[0]).partition(",")[0] for arguments in search.signatures})
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert set(done.stdout.split()) == {
        f"SampledMatrix(array({kind}" for kind in ("float64", "complex128")
    }


@needs_compiler
def test_without_numba_the_map_is_the_same(tmp_path: Path) -> None:
    """Machine code may differ from Python in the last bits, and no cell's class may."""
    compile_if_needed(lambda line: None)
    scenario = SCENARIO.format(encoding="iq", rate_hz=25e3, duration_s=0.2)
    # Python takes a second for each square metre, and more.
    near = scenario.replace("max_range_m: 3.0", "max_range_m: 2.2")
    (tmp_path / "scenario.yaml").write_text(near)
    has_numba, has_none = "import sys", "import sys; sys.modules['numba'] = None"
    said = {}
    for folder, begin in (("bag", has_numba), ("with", has_numba), ("without", has_none)):
        program = f"{begin}; from usmap_ros.cli import main; main()"
        arguments = ["map", "bag", "-o", folder, "--resolution", "0.1"]
        if folder == "bag":
            arguments = ["simulate", "scenario.yaml", "-o", "bag"]
        command = [sys.executable, "-c", program, *arguments]
        done = subprocess.run(command, cwd=tmp_path, text=True, capture_output=True, check=True)
        said[folder] = done.stderr
    assert (said["with"], said["without"]) == ("", f"usmap: Numba is missing: {SLOW}\n")
    (one, _), (other, _) = load_map(tmp_path / "with"), load_map(tmp_path / "without")
    assert one.observed.sum() > 10
    np.testing.assert_array_equal(one.observed, other.observed)
    np.testing.assert_array_equal(
        one.probability() >= OCCUPIED_PROBABILITY, other.probability() >= OCCUPIED_PROBABILITY
    )
    np.testing.assert_allclose(one.log_odds, other.log_odds, rtol=0.0, atol=1e-3)


@needs_compiler
def test_with_a_numba_that_fails_commands_run_as_python(tmp_path: Path) -> None:
    """As with a release that refuses what those before it compiled."""
    scenario = SCENARIO.format(encoding="iq", rate_hz=25e3, duration_s=0.2)
    (tmp_path / "scenario.yaml").write_text(scenario)
    # Each process that finds it has it, those that compile too.
    (tmp_path / "other" / "sitecustomize.py").parent.mkdir()
    (tmp_path / "other" / "sitecustomize.py").write_text(
        "import numba\nnumba.njit = lambda **options: numba.jit(unheard_of=True, nopython=True)\n"
    )
    other = os.pathsep.join([str(tmp_path / "other"), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept")}
    for arguments in (["simulate", "scenario.yaml", "-o", "bag"], ["info", "bag"]):
        done = subprocess.run(
            [sys.executable, "-m", "usmap_ros", *arguments],
            cwd=tmp_path,
            text=True,
            capture_output=True,
            check=True,
            env=environment,
        )
        environment["PYTHONPATH"] = other
    once, slow = done.stderr.splitlines()
    assert once == f"usmap: {ONCE}"
    assert slow.startswith(f"usmap: Numba {version('numba')} fails (KeyError: ")
    assert slow.endswith(f"): {SLOW}")
    assert "pings      4" in done.stdout


@needs_compiler
@pytest.mark.parametrize(
    ("encoding", "rate_hz", "duration_s"),
    [("iq", 25e3, 2.0), ("raw", 25e4, 0.2), ("envelope", 25e3, 0.2)],
)
def test_a_map_has_nothing_left_to_compile(
    tmp_path: Path, encoding: str, rate_hz: float, duration_s: float
) -> None:
    scenario = SCENARIO.format(encoding=encoding, rate_hz=rate_hz, duration_s=duration_s)
    assert_nothing_is_compiled(scenario, tmp_path)


@needs_compiler
def test_a_map_of_smooth_walls_has_nothing_left_to_compile(tmp_path: Path) -> None:
    """Mirrors and columns are looked for where there are walls, and errors in many pings."""
    room = yaml.safe_load((SOURCE.parents[1] / "config/scenarios/room.yaml").read_text())
    room["duration_s"] = 4.0
    room["world"]["surface"] = {"specular_reflectivity": 0.5, "diffuse_reflectivity": 0.0}
    assert_nothing_is_compiled(yaml.safe_dump(room), tmp_path)


def assert_nothing_is_compiled(scenario: str, tmp_path: Path) -> None:
    """Check that neither a map of it nor a plan has any loop compiled."""
    compile_if_needed(lambda line: None, ALL)
    (tmp_path / "scenario.yaml").write_text(scenario)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", PROGRAM, *arguments]
        done = subprocess.run(command, cwd=tmp_path, text=True, capture_output=True, check=False)
        assert done.returncode == 0, done.stderr
        return done

    run("simulate", "scenario.yaml", "-o", "bag")
    done = run("map", "bag", "-o", "map", "--jobs", "1")
    assert json.loads(done.stdout.splitlines()[-1]) == []
    assert done.stderr == ""
    # LLVM alone would take several hundred megabytes.
    assert json.loads((tmp_path / "map/summary.json").read_text())["peak_memory_mb"] < 400
    done = run("plan", "map", "--json")
    assert json.loads(done.stdout.splitlines()[-1]) == []
