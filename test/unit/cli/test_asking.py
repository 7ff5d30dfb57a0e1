"""What commands ask, complete and count."""

import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer

from usmap_ros.cli.map import map_bags
from usmap_ros.cli.mapped import seconds_since_start
from usmap_ros.cli.parameters import complete_setting
from usmap_ros.errors import BagError


def test_map_asks_before_it_replaces_a_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "map.npz").touch()
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: True))
    asked = []

    def refuse(question: str, **options: bool) -> None:
        asked.append(question)
        raise typer.Abort

    monkeypatch.setattr(typer, "confirm", refuse)
    with pytest.raises(typer.Abort):
        map_bags([tmp_path / "bag"], tmp_path, jobs=1)
    assert asked == [f"{tmp_path}: holds a map already; replace it?"]
    with pytest.raises(BagError, match="does not exist"):
        map_bags([tmp_path / "bag"], tmp_path, force=True, jobs=1)
    # A program, which nobody can ask, says what it replaces.
    monkeypatch.setattr("sys.stdin", SimpleNamespace(isatty=lambda: False))
    with pytest.raises(BagError, match="does not exist"):
        map_bags([tmp_path / "bag"], tmp_path, jobs=1)
    assert len(asked) == 1


def test_a_shell_completes_the_names_of_parameters() -> None:
    assert complete_setting("mapping.resol") == ["mapping.resolution_m="]
    assert "reconstruction.correction.gain=" in complete_setting("reconstruction.")
    assert complete_setting("nothing") == []


def test_seconds_count_from_the_start_of_the_process() -> None:
    before = seconds_since_start()
    time.sleep(0.02)
    after = seconds_since_start()
    assert 0.0 < before < after < before + 60.0
