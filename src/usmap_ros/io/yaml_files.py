"""YAML files of parameters: read into checked models, and written with their documentation."""

import difflib
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from usmap_ros.errors import ConfigurationError, shortened
from usmap_ros.io.yaml_text import read_yaml
from usmap_ros.parameters.fields import constraints_of, is_model, unit_of

_Model = TypeVar("_Model", bound=BaseModel)

_BEGINS_WITH_KEY = re.compile(r"[a-z]\w*(\.\w+)*: ")

#: Width of the lines that are written.
LINE = 100


def load_yaml(path: Path, model: type[_Model]) -> _Model:
    """Read a YAML file into a model; an empty file gives the model's defaults.

    Parameters
    ----------
    path : path
        YAML of the model's keys, at most 1 MiB.
    model : type
        A pydantic model that forbids unknown keys.

    Raises
    ------
    ConfigurationError
        In one line: the file, the field with its groups, and what is wrong with it.
    """
    return validated(path, model, read_mapping(path))


def read_mapping(path: Path) -> dict[str, Any]:
    """Read a YAML file of keys and values; an empty file gives none.

    Raises
    ------
    ConfigurationError
        If there is no such file, or something else in it.
    """
    content = read_yaml(path, ConfigurationError)
    if content is None:
        return {}
    if not isinstance(content, dict):
        raise ConfigurationError(path, f"holds a {type(content).__name__} instead of keys")
    return content


def validated(source: str | Path, model: type[_Model], content: dict[str, Any]) -> _Model:
    """Make a model of `content`; `source` is what an error names as its origin.

    Raises
    ------
    ConfigurationError
        As `load_yaml`.
    """
    try:
        return model.model_validate(content)
    except ValidationError as error:
        # A key that is unknown comes first: it may be why another one is missing.
        first, *others = sorted(error.errors(), key=lambda one: one["type"] != "extra_forbidden")
        more = f" (and {len(others)} more)" if others else ""
        raise ConfigurationError(source, _cause(first, model) + more) from error


def dump_yaml(model: BaseModel) -> str:
    """Write a model as YAML in which a comment explains every field: unit, bounds, meaning."""
    return "\n".join(_lines(model, indent="")) + "\n"


#: What pydantic says of some errors, by its name for them, in words for people; their context and
#: the value fill in the blanks.
_IN_WORDS = {
    "missing": "is missing",
    "union_tag_not_found": "is missing",
    "union_tag_invalid": "should be one of {expected_tags} (is '{tag}')",
    "string_pattern_mismatch": "should begin with a letter, and be letters, digits and _ only",
    "too_short": "should have at least {min_length} entries, has {actual_length}",
    "too_long": "should have at most {max_length} entries, has {actual_length}",
    "list_type": "should be a list",
    "tuple_type": "should be a list",
    "model_type": "should be keys with values",
    "model_attributes_type": "should be keys with values",
    "dict_type": "should be keys with values",
    "float_type": "should be a number",
    "float_parsing": "should be a number",
    "int_type": "should be a whole number",
    "int_parsing": "should be a whole number",
    "int_from_float": "should be a whole number",
    "bool_type": "should be true or false",
    "bool_parsing": "should be true or false",
    "string_type": "should be a text",
    "path_type": "should be the path of a file",
}


def _cause(error: Any, model: type[BaseModel]) -> str:
    """One clause for an error of pydantic, with the field in dots."""
    location = _keys(error, model)
    where = ".".join(shortened(str(part), 40) for part in location)
    if error["type"] == "extra_forbidden":
        nearest = difflib.get_close_matches(
            str(location[-1]), _known_keys(model, location[:-1]), n=1
        )
        return f"{where}: unknown key" + (f", did you mean {nearest[0]!r}?" if nearest else "")
    if error["type"] == "missing" and isinstance(location[-1], int):
        group = ".".join(map(str, location[:-1]))
        return f"{group}: should have more entries, has {location[-1]}"
    if error["type"] in _IN_WORDS:
        words = {key: shortened(str(part), 200) for key, part in error.get("ctx", {}).items()}
        reason = _IN_WORDS[error["type"]].format(**words)
    else:
        reason = error["msg"].removeprefix("Input ").removeprefix("Value error, ")
    given = error["input"]
    shown = ""
    if isinstance(given, str | int | float | bool | None):
        shown = f" (is {_quoted(given)})"
    if not where:
        return f"{reason}{shown}"
    # What a group checks as a whole names the key itself.
    between = "." if error["type"] == "value_error" and _BEGINS_WITH_KEY.match(reason) else ": "
    return f"{where}{between}{reason}{shown}"


def _keys(error: Any, model: type[BaseModel]) -> tuple[int | str, ...]:
    """Keys and positions that lead to an error, without the kinds that pydantic puts in."""
    location = error["loc"]
    last = len(location) - 1
    is_named = error["type"] in ("extra_forbidden", "missing")
    keys = tuple(
        part
        for place, part in enumerate(location)
        if isinstance(part, int)
        or (place == last and is_named)
        or part in _known_keys(model, location[:place])
    )
    # Which kind of group it is, a key of the group itself says.
    kind = error.get("ctx", {}).get("discriminator")
    return (*keys, kind.strip("'")) if kind else keys


def _quoted(given: str | int | float | bool | None) -> str:
    """A value as Python writes it, unless it is a number with too many digits to be written."""
    try:
        return shortened(repr(given), 60)
    except ValueError:
        return "a very large number"


def _known_keys(model: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Keys of the group at `location`; positions in lists and tags of unions have no names."""
    candidates = [model]
    for part in location:
        inner = [
            group
            for candidate in candidates
            if part in candidate.model_fields
            for group in _models_in(candidate.model_fields[str(part)].annotation)
        ]
        candidates = inner or candidates
    return [name for candidate in candidates for name in candidate.model_fields]


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models that a type annotation mentions, such as that of a list's items."""
    if is_model(annotation):
        yield annotation
    for argument in getattr(annotation, "__args__", ()):
        yield from _models_in(argument)


def _lines(model: BaseModel, indent: str) -> Iterator[str]:
    for name, info in type(model).model_fields.items():
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            heading = info.description or (type(value).__doc__ or "").splitlines()[0]
            yield f"{indent}# {heading.rstrip('.')}"
            yield f"{indent}{name}:"
            yield from _lines(value, indent + "  ")
            continue
        plain = model.model_dump(mode="json", include={name})[name]
        # A scalar is followed by the line "...", which ends a document.
        text = yaml.safe_dump(plain, default_flow_style=True, width=10_000).splitlines()[0]
        comment = f"{indent}# "
        yield from textwrap.wrap(
            _documentation(info), LINE, initial_indent=comment, subsequent_indent=comment
        )
        yield f"{indent}{name}: {text}"


def _documentation(info: FieldInfo) -> str:
    """Describe a field: its meaning, unit and bounds or choices."""
    unit, constraints = unit_of(info), constraints_of(info)
    return (
        (info.description or "").rstrip(".")
        + (f" [{unit}]" if unit else "")
        + (f" ({constraints})" if constraints else "")
    )
