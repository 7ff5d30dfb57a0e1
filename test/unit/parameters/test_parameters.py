"""Parameters are declared once, completely, and refuse what makes no sense."""

from typing import Any, ClassVar

import pytest
from pydantic import BaseModel, ValidationError

from usmap_ros.parameters import (
    CorrectionParameters,
    MappingParameters,
    ParameterGroup,
    PipelineParameters,
    ReconstructionParameters,
    quantity,
)
from usmap_ros.parameters.fields import flat_fields, former_names
from usmap_ros.parameters.nodes import ConeReconstructorParameters, MapFusionParameters
from usmap_ros.parameters.nodes.common import check_globs, is_one_of

GROUPS: list[type[BaseModel]] = [CorrectionParameters, ReconstructionParameters, MappingParameters]
#: Of another model, as newer and older versions of pydantic write it.
REFERENCES = {"$ref", "allOf"}
UNITS_BY_SUFFIX = {"_m_s": "m/s", "_m": "m", "_s": "s", "_hz": "Hz", "_rad": "rad"}


def own_parameters(group: type[BaseModel]) -> list[tuple[str, dict[str, Any]]]:
    """Name and schema of the parameters of a group; a group in it is another's."""
    properties = group.model_json_schema()["properties"]
    return [(name, schema) for name, schema in properties.items() if not schema.keys() & REFERENCES]


@pytest.mark.parametrize("group", GROUPS)
def test_every_parameter_has_a_description_a_unit_and_its_suffix(group: type[BaseModel]) -> None:
    for name, description in own_parameters(group):
        assert description["description"].endswith("."), name
        units = [unit for suffix, unit in UNITS_BY_SUFFIX.items() if name.endswith(suffix)]
        assert description["unit"] == (units[0] if units else ""), name


@pytest.mark.parametrize("group", GROUPS)
def test_every_number_has_bounds(group: type[BaseModel]) -> None:
    for name, description in own_parameters(group):
        if description["type"] in ("number", "integer"):
            assert description.keys() & {"minimum", "exclusiveMinimum"}, name
            bounded = description.keys() & {"maximum", "exclusiveMaximum"}
            # Clamps that name their own sign are bounded by it on the other side.
            assert bounded, name


def test_the_defaults_are_valid() -> None:
    assert PipelineParameters.model_validate({}) == PipelineParameters()


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"prior": 0.0}, "prior"),
        ({"prior": 1.0}, "prior"),
        ({"resolution_m": 0.0}, "resolution_m"),
        ({"detection_probability": 1.0}, "detection_probability"),
        ({"least_log_odds": 0.5}, "least_log_odds"),
        ({"greatest_log_odds": float("inf")}, "greatest_log_odds"),
        ({"forgetting": float("nan")}, "forgetting"),
        ({"method": "magic"}, "method"),
        ({"windw": 3}, "windw"),
    ],
)
def test_a_bad_value_or_an_unknown_name_is_refused(values: dict[str, object], name: str) -> None:
    with pytest.raises(ValidationError, match=name):
        MappingParameters.model_validate(values)


def test_a_solver_is_refused_without_the_dictionary_that_it_needs() -> None:
    with pytest.raises(ValidationError, match="omp needs the dictionary of cells"):
        ReconstructionParameters(solver="omp")
    assert ReconstructionParameters(solver="omp", dictionary="cells").solver == "omp"


def test_a_former_name_is_understood_with_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    class Now(ParameterGroup):
        renamed: ClassVar[dict[str, str]] = {"size": "length_m"}

        length_m: float = quantity(1.0, "A length.", "m", gt=0.0, le=9.0)

    class Above(ParameterGroup):
        now: Now = Now()

    assert Above.model_validate({"now": {"size": 2.0}}).now.length_m == 2.0
    assert caplog.messages == [
        "parameter size is called length_m now; its former name is understood for one version"
    ]
    assert Now.model_validate({"size": 2.0, "length_m": 3.0}).length_m == 3.0
    with pytest.raises(ValidationError, match="length_m"):
        Now.model_validate({"size": -2.0})
    assert list(former_names(Above)) == [("now.size", "now.length_m")]


def test_former_names_lead_to_parameters_that_exist() -> None:
    for group in (PipelineParameters, ConeReconstructorParameters, MapFusionParameters):
        names = dict(flat_fields(group))
        assert all(name in names and old not in names for old, name in former_names(group))


def test_parameters_cannot_be_changed_behind_the_pipelines_back() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        MappingParameters().prior = 0.5  # type: ignore[misc]


def test_a_default_out_of_its_own_bounds_is_found_at_once() -> None:
    class Wrong(ParameterGroup):
        size_m: float = quantity(-1.0, "A size.", "m", gt=0.0)

    with pytest.raises(ValidationError, match="size_m"):
        Wrong()


@pytest.mark.parametrize(
    ("globs", "name", "is_one"),
    [
        ("*", "/robot1/cone", True),
        ("*/cone", "/robot1/cone", True),
        ("/robot[12]/cone", "/robot3/cone", False),
        ("/a/* /b/*", "/b/left/cone", True),
        ("/a/* /b/*", "/c/cone", False),
        ("/robot?/cone", "/robot12/cone", False),
        ("robot1", "/robot1/cone", False),
        # As regular expressions had it, which these were.
        (".*", "/robot1/cone", True),
        (".*/cone", "/robot1/cone", True),
        ("", "/robot1/cone", False),
    ],
)
def test_globs_choose_topics(globs: str, name: str, is_one: bool) -> None:
    assert is_one_of(name, check_globs(globs)) is is_one


@pytest.mark.parametrize("pattern", ["(a+)+$", "/robot(1|2)/.*", "[^/]*", "x" * 5000])
def test_regular_expressions_are_no_globs(pattern: str) -> None:
    """They can take longer than the universe lasts: (a+)+$ with a name of 40 letters."""
    with pytest.raises(ValueError, match=r"is no glob|has 5000 characters"):
        check_globs(pattern)
