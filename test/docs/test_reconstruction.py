"""The page on reconstruction tells of the modules and parameters that there are."""

import re
from pathlib import Path

from usmap_ros.parameters import ReconstructionParameters

ROOT = Path(__file__).parents[2]
#: Parameters of the default dictionary.
EXPLAINED = (
    "dictionary", "sparsity", "non_negative", "false_alarms_per_ping", "model_error",
    "oversampling", "exclusion", "chirp_sweep_hz", "refinements", "masking", "interference",
    "max_iterations", "limit_step_m", "upright_objects", "object_height_m",
)  # fmt: skip


def test_it_names_modules_and_parameters_that_there_are() -> None:
    page = (ROOT / "docs" / "reconstruction.md").read_text(encoding="utf-8")
    folder = ROOT / "src/usmap_ros/reconstruction"
    steps = page.split("One trace goes through these steps:")[1].split("\n## ")[0]
    for module in set(re.findall(r"`([a-z_]+)`", steps)) - set(
        ReconstructionParameters.model_fields
    ):
        assert (folder / f"{module}.py").is_file(), module
    for name in EXPLAINED:
        assert name in ReconstructionParameters.model_fields, name
        assert f"`{name}`" in page or f"`{name}:" in page, name
