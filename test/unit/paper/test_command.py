"""The command ``usmap paper``, on a study of two parts."""

import pytest
from typer.testing import CliRunner

from usmap_ros.cli.app import app
from usmap_ros.errors import FileError
from usmap_ros.paper import study
from usmap_ros.paper.figures_2_3 import beam_patterns
from usmap_ros.paper.part import Part
from usmap_ros.plotting.style import new_figure


def summary():
    row = {"support_found": 1.0, "f1": 1.0, "relative_residual": 0.0, "milliseconds": 1.0}
    return Part("solvers_table", {"summary": [{"solver": "cosamp"} | row]}, new_figure(1.0, 1.0))


@pytest.fixture(autouse=True)
def two_parts(monkeypatch):
    monkeypatch.setattr(study, "PARTS", (beam_patterns, summary))


def test_pictures_and_numbers_are_in_the_folder(tmp_path):
    result = CliRunner().invoke(app, ["paper", "-o", str(tmp_path / "new")])

    assert result.exit_code == 0, result.output
    assert "cosamp" in result.output
    assert {path.name for path in (tmp_path / "new").iterdir()} == {
        "paper.json",
        "figure_2_beam_patterns.png",
        "solvers_table.png",
    }


def test_output_is_required():
    assert CliRunner().invoke(app, ["paper"]).exit_code == 2


def test_unusable_folder_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    result = CliRunner().invoke(app, ["paper", "-o", str(tmp_path / "file")])

    assert isinstance(result.exception, FileError)
    assert str(tmp_path / "file") in str(result.exception)
