"""Linear algebra keeps to one core, unless the user wants it otherwise."""

import os
import subprocess
import sys

import pytest

from usmap_ros.processes.cores import THREAD_VARIABLES, keep_linear_algebra_to_one_core


def test_linear_algebra_keeps_to_one_core(monkeypatch: pytest.MonkeyPatch) -> None:
    for variable in THREAD_VARIABLES:
        monkeypatch.delenv(variable, raising=False)
    keep_linear_algebra_to_one_core()
    assert [os.environ[variable] for variable in THREAD_VARIABLES] == ["1", "1", "1"]


def test_what_the_user_says_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    keep_linear_algebra_to_one_core()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "3"


def test_numpy_is_not_imported_before_the_command_line_says_so() -> None:
    code = "import sys, usmap_ros.cli; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
