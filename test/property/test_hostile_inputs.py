"""Wrong files of every kind end in clear errors: some of what ``python tools/fuzz`` tries."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = "scenario,parameters,nav2 map,image,metadata,mcap,sqlite3,map.npz"


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_wrong_files_end_in_clear_errors() -> None:
    command = [sys.executable, str(ROOT / "tools/fuzz"), "--count", "40", "--seed", "7"]
    command += ["--kinds", FILES]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
