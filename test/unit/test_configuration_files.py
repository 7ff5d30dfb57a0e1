"""Every file in config/ that a user may start from is valid and up to date."""

from pathlib import Path

import pytest

from usmap_ros.io.yaml_files import dump_yaml, load_yaml
from usmap_ros.parameters import PipelineParameters
from usmap_ros.simulation.scenario import Scenario

ROOT = Path(__file__).parents[2]
PIPELINE_FILES = ("defaults.yaml", "coarse.yaml", "classic.yaml")


@pytest.mark.parametrize("name", PIPELINE_FILES)
def test_the_pipeline_takes_a_parameter_file(name: str) -> None:
    parameters = load_yaml(ROOT / "config" / "parameters" / name, PipelineParameters)
    assert (parameters == PipelineParameters()) is (name == "defaults.yaml")


def test_the_file_of_defaults_is_what_the_code_declares() -> None:
    """`make docs` writes it anew."""
    text = (ROOT / "config" / "parameters" / "defaults.yaml").read_text(encoding="utf-8")
    assert text.endswith("\n\n" + dump_yaml(PipelineParameters()))


@pytest.mark.parametrize("path", sorted(ROOT.glob("config/scenarios/*.yaml")), ids=lambda p: p.stem)
def test_a_scenario_loads_and_has_pings(path: Path) -> None:
    assert Scenario.load(path).ping_count > 0
