"""Every file in config/ that a user may start from is valid and up to date."""

from pathlib import Path

import pytest

from usmap_ros.io.yaml_files import load_yaml
from usmap_ros.parameters import PipelineParameters

ROOT = Path(__file__).parents[2]
PIPELINE_FILES = ("defaults.yaml", "coarse.yaml", "classic.yaml")


@pytest.mark.parametrize("name", PIPELINE_FILES)
def test_the_pipeline_takes_a_parameter_file(name: str) -> None:
    parameters = load_yaml(ROOT / "config" / "parameters" / name, PipelineParameters)
    assert (parameters == PipelineParameters()) is (name == "defaults.yaml")
