"""The page on reconstruction tells of the modules and parameters that there are."""

import re
from pathlib import Path

from usmap_ros.parameters import ReconstructionParameters

ROOT = Path(__file__).parents[2]


def test_it_names_modules_and_parameters_that_there_are() -> None:
    page = (ROOT / "docs" / "reconstruction.md").read_text(encoding="utf-8")
    folder = ROOT / "src/usmap_ros/reconstruction"
    steps = page.split("One trace goes through these steps:")[1].split("\n## ")[0]
    for module in set(re.findall(r"`([a-z_]+)`", steps)) - set(
        ReconstructionParameters.model_fields
    ):
        assert (folder / f"{module}.py").is_file(), module
    for name in ReconstructionParameters.model_fields:
        if name not in ("solver", "cell_size_m"):
            assert f"`{name}`" in page or f"`{name}:" in page, name
