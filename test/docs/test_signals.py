"""What docs/signals.md shows works as it stands there."""

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from usmap_ros.simulation.models.world import WorldModel

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "signals.md").read_text(encoding="utf-8")
CHIRP, BEARINGS, OFF_PLANE = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)


def shown(code: str) -> list[str]:
    """Lines that a block of the page prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, "docs/signals.md", "exec"), {})
    return printed.getvalue().splitlines()


def numbers(line: str) -> list[float]:
    return [float(word) for word in line.strip("[]").split()]


def test_a_chirp_tells_neighbours_apart() -> None:
    (ranges_m,) = shown(CHIRP)
    np.testing.assert_allclose(numbers(ranges_m), [1.2, 1.23], atol=2e-3)


def test_two_receivers_tell_bearings() -> None:
    bearings_deg, right = shown(BEARINGS)
    np.testing.assert_allclose(numbers(bearings_deg), [10.4, -12.4], atol=0.6)
    assert right == "None"


def test_objects_off_the_plane_are_explained() -> None:
    plane, told = (float(line) for line in shown(OFF_PLANE))
    assert plane > 0.5
    assert told < 0.1


@pytest.mark.parametrize("block", re.findall(r"```yaml\n(.*?)```", PAGE, flags=re.DOTALL))
def test_scenario_keys_are_keys(block: str) -> None:
    WorldModel.model_validate(yaml.safe_load(block)["world"])
