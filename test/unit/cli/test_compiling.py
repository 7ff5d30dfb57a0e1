"""Commands that need the inner loops compile them first, and say so."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from usmap_ros.runs import compilation
from usmap_ros.runs.compilation import ONCE
from usmap_ros.runs.small_session import ALL, SESSION


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["map", "bag", "-o", "other"], SESSION),
        (["info", "bag"], SESSION),
        (["plot", "bag", "-o", "ping.png"], SESSION),
        (["calibrate", "bag"], SESSION),
        (["compile"], ALL),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_a_command_compiles_first(
    usmap: Callable[..., Any],
    workspace: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    parts: dict[str, Any],
) -> None:
    asked: list[object] = []

    def compile_if_needed(say: Callable[[str], None], wanted: object) -> None:
        say(ONCE)
        asked.append(wanted)

    monkeypatch.setattr(compilation, "compile_if_needed", compile_if_needed)
    done = usmap(*arguments, cwd=workspace)
    assert done.stderr.splitlines()[0] == f"usmap: {ONCE}"
    assert asked == [parts]
