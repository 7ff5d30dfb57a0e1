from pathlib import Path

import pytest
from pydantic import Field

from usmap_ros.errors import ConfigurationError
from usmap_ros.io.yaml_files import dump_yaml, load_yaml, read_mapping
from usmap_ros.parameters import ParameterGroup, PipelineParameters, quantity


class Wheel(ParameterGroup):
    """One wheel."""

    radius_m: float = quantity(0.1, "From hub to rim.", "m", gt=0.0, le=1.0)


class Robot(ParameterGroup):
    """A robot on wheels."""

    name: str = quantity("robin", "What it is called.")
    mass_kg: float = quantity(..., "All of it.", "kg", ge=0.0)
    spare: Wheel = quantity(Wheel(), "In the boot.")
    wheels: list[Wheel] = Field(default_factory=list, description="Those it drives on.")


def refusal(tmp_path: Path, text: str) -> str:
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationError) as raised:
        load_yaml(path, Robot)
    assert str(raised.value).startswith(f"{path}: ")
    assert "\n" not in str(raised.value)
    return raised.value.cause


def test_a_file_becomes_a_model(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text("mass_kg: 3\nwheels: [{radius_m: 0.2}]\n")
    robot = load_yaml(tmp_path / "robot.yaml", Robot)
    assert robot == Robot(mass_kg=3.0, wheels=[Wheel(radius_m=0.2)])


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("mass_kg: 1\nnane: x", "nane: unknown key, did you mean 'name'?"),
        ("mass_kg: 1\ntotally_different: x", "totally_different: unknown key"),
        ("mass_kg: 1\nspare: {radios_m: 1}",
         "spare.radios_m: unknown key, did you mean 'radius_m'?"),
        ("mass_kg: 1\nwheels: [{}, {radius: 1}]",
         "wheels.1.radius: unknown key, did you mean 'radius_m'?"),
        ("mess_kg: 1", "mess_kg: unknown key, did you mean 'mass_kg'? (and 1 more)"),
        ("{}", "mass_kg: is missing"),
        ("mass_kg: -1", "mass_kg: should be greater than or equal to 0 (is -1)"),
        ("mass_kg: heavy",
         "mass_kg: should be a number (is 'heavy')"),
        ("mass_kg: -1\nname: 3",
         "name: should be a text (is 3) (and 1 more)"),
        ("mass_kg: 1\nmass_kg: 2", "line 2: 'mass_kg' stands twice"),
        ("mass_kg: [1", "line 1: expected ',' or ']', but got '<stream end>'"),
        ("- 1\n- 2", "holds a list instead of keys"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path: Path, text: str, cause: str) -> None:
    assert refusal(tmp_path, text) == cause


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"none.yaml: does not exist$"):
        read_mapping(tmp_path / "none.yaml")


def test_a_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"cannot be read: Is a directory$"):
        read_mapping(tmp_path)


def test_bytes_are_named(tmp_path: Path) -> None:
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(ConfigurationError, match=r"is not a text file$"):
        read_mapping(tmp_path / "bytes.yaml")


def test_an_empty_file_gives_the_defaults(tmp_path: Path) -> None:
    (tmp_path / "empty.yaml").touch()
    assert load_yaml(tmp_path / "empty.yaml", PipelineParameters) == PipelineParameters()


def test_what_is_dumped_says_what_it_means() -> None:
    text = dump_yaml(Robot(mass_kg=3.0, wheels=[Wheel()]))
    assert text.splitlines() == [
        "# What it is called",
        "name: robin",
        "# All of it [kg] (≥ 0)",
        "mass_kg: 3.0",
        "# In the boot",
        "spare:",
        "  # From hub to rim [m] (> 0, ≤ 1)",
        "  radius_m: 0.1",
        "# Those it drives on",
        "wheels: [{radius_m: 0.1}]",
    ]


def test_what_is_dumped_can_be_loaded(tmp_path: Path) -> None:
    (tmp_path / "defaults.yaml").write_text(dump_yaml(PipelineParameters()))
    assert load_yaml(tmp_path / "defaults.yaml", PipelineParameters) == PipelineParameters()
