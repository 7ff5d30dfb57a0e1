"""Wrong files and messages end in clear errors: some of what ``python tools/fuzz`` tries."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_wrong_files_and_messages_end_in_clear_errors() -> None:
    command = [sys.executable, str(ROOT / "tools/fuzz"), "--count", "25", "--seed", "7"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
