"""The trials of tools/trials, a few rounds of each: endings and kills lose nothing."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("domain")]

TRIALS = Path(__file__).parents[2] / "tools/trials"


@pytest.mark.parametrize(
    "trial",
    [["kills", "--count", "2"], ["fleets", "--count", "1", "--robots", "2"]],
    ids=lambda trial: trial[0],
)
def test_a_few_rounds_of_a_trial(trial: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, str(TRIALS), *trial, "--patience", "250"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "troubles: 0" in done.stdout
