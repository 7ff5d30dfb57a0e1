"""The table of faulty robots, in small: `tools/trials faults` makes the whole of it."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SHARES = r"\d\.\d\d, \d\.\d\d"


@pytest.mark.slow
def test_what_faulty_robots_cost_the_map_is_told() -> None:
    command = [
        sys.executable, str(ROOT / "tools/trials"), "faults", "--scenes", "poles",
        "--seeds", "1", "--faults", "gain x100", "clipped", "dead", "liar", "--within", "0.1",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    _, healthy, *rows = done.stdout.splitlines()
    assert healthy == "poles, healthy: accused in 0 of 1"
    row = re.compile(rf"poles, (.*): ({SHARES}); ({SHARES}); ({SHARES}); (\d) of 1; 0 of 1")
    found = {match[1]: match for line in rows if (match := row.fullmatch(line))}
    assert list(found) == ["gain x100", "clipped", "dead", "liar"]
    for match in found.values():
        # Each is named, and what it said is not in the map.
        assert match[5] == "1"
        assert match[3] == match[4]


@pytest.mark.slow
def test_a_fault_that_costs_more_than_is_asked_for_ends_in_trouble() -> None:
    command = [
        sys.executable, str(ROOT / "tools/trials"), "faults", "--scenes", "poles",
        "--seeds", "1", "--pings", "30", "--faults", "gain x100", "--within", "-1",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stderr
    assert "TROUBLE poles, gain x100: costs" in done.stdout


def test_who_is_named_is_told_without_maps() -> None:
    command = [
        sys.executable, str(ROOT / "tools/trials"), "faults", "--scenes", "poles", "--no-maps",
        "--seeds", "1", "--pings", "30", "--faults", "gain x100",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[1:] == [
        "poles, healthy: 0; 0; 0 of 1",
        "poles, gain x100: 1; 0; 0 of 1",
    ]
