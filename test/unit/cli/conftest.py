"""What the tests of the command line share."""

import contextlib
import io
import logging
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from usmap_ros.cli import main
from usmap_ros.runs.compilation import compile_if_needed

SCENARIO = """\
seed: 3
duration_s: 1.0
world:
  points:
    - {x_m: 2.025, y_m: 0.425, reflectivity: 1.0}
    - {x_m: 1.525, y_m: -0.575, reflectivity: 0.8}
robots:
  - name: robot1
    motion: {kind: waypoints, waypoints_m: [[0.0, -1.0], [0.0, 1.0]], speed_m_s: 1.0}
    transducers:
      - mount: {yaw_rad: -1.2}
        receiver: {encoding: iq, sample_rate_hz: 25000.0, noise_std: 0.01}
"""


@dataclass(frozen=True)
class Done:
    """How a run of the program ended."""

    returncode: int
    stdout: str
    stderr: str


@pytest.fixture(scope="session")
def usmap() -> Callable[..., Done]:
    """Give a function that runs the program, in this process because that is much faster."""
    # Or the first command would, and say so.
    compile_if_needed(lambda line: None)

    def run(*arguments: str, cwd: Path) -> Done:
        output, errors = io.StringIO(), io.StringIO()
        status = 0
        with (
            pytest.MonkeyPatch.context() as patch,
            contextlib.redirect_stdout(output),
            contextlib.redirect_stderr(errors),
            untouched_logging(),
        ):
            patch.setattr(sys, "argv", ["usmap", *arguments])
            patch.chdir(cwd)
            for library in ("OPENBLAS", "MKL", "OMP"):
                patch.setenv(f"{library}_NUM_THREADS", "1")
            try:
                main()
            except SystemExit as end:
                status = end.code if isinstance(end.code, int) else int(end.code is not None)
        return Done(status, output.getvalue(), errors.getvalue())

    return run


@contextlib.contextmanager
def untouched_logging() -> Iterator[None]:
    """Leave the package's logger as it was."""
    logger = logging.getLogger("usmap_ros")
    before = logger.level, logger.propagate, logger.handlers
    yield
    logger.level, logger.propagate, logger.handlers = before


@pytest.fixture(scope="session")
def recorded(usmap: Callable[..., Done], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with a scenario, its recording, its truth and a map; not to be changed."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "scenario.yaml").write_text(SCENARIO)
    for arguments in (
        ["simulate", "scenario.yaml", "-o", "bag", "--truth", "truth.yaml"],
        ["map", "bag", "-o", "map"],
    ):
        done = usmap(*arguments, cwd=folder)
        assert done.returncode == 0, done.stderr
        assert done.stderr == ""
    return folder


@pytest.fixture
def workspace(recorded: Path, tmp_path: Path) -> Path:
    """Give a copy of `recorded` that may be changed."""
    shutil.copytree(recorded, tmp_path / "work")
    return tmp_path / "work"


@pytest.fixture(scope="session")
def undecided(
    usmap: Callable[..., Done], recorded: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Give a folder with a map of a few pings, which leave open where the poles are."""
    folder = tmp_path_factory.mktemp("undecided")
    scenario = (
        (recorded / "scenario.yaml").read_text().replace("duration_s: 1.0", "duration_s: 0.3")
    )
    (folder / "scenario.yaml").write_text(scenario)
    for arguments in (["simulate", "scenario.yaml", "-o", "bag"], ["map", "bag", "-o", "map"]):
        done = usmap(*arguments, cwd=folder)
        assert done.returncode == 0, done.stderr
    return folder
