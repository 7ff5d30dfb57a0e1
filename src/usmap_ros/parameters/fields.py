"""How a parameter is declared, and what its declaration says of it."""

import logging
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import Any, ClassVar, TypeGuard, get_origin

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic.fields import FieldInfo

_logger = logging.getLogger(__name__)


def quantity(default: Any, description: str, unit: str = "", **bounds: Any) -> Any:
    """Field with a default, a description, a unit and bounds (``ge``, ``gt``, ``le``, ``lt``).

    `unit` is an SI unit or "" for a pure number; it is kept in the field's JSON schema.
    """
    return Field(default, description=description, json_schema_extra={"unit": unit}, **bounds)


class ParameterGroup(BaseModel):
    """Base of all parameter groups: immutable, and an unknown key is an error."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        validate_default=True,
        allow_inf_nan=False,
        protected_namespaces=(),
    )
    #: Names that fields had in the version before, with those that they have now.  What is given
    #: under the former one is taken, with a warning; the version after this forgets it.
    renamed: ClassVar[Mapping[str, str]] = {}

    @model_validator(mode="before")
    @classmethod
    def _read_former_names(cls, content: Any) -> Any:
        if not isinstance(content, Mapping) or not cls.renamed.keys() & content.keys():
            return content
        taken = dict(content)
        for former, name in cls.renamed.items():
            if former in taken:
                _warn_of_former_name(former, name)
                # What is set on top of a file may have the new name already.
                value = taken.pop(former)
                taken.setdefault(name, value)
        return taken


@lru_cache(maxsize=64)
def _warn_of_former_name(former: str, name: str) -> None:
    """Say once what a parameter is called now."""
    _logger.warning(
        "parameter %s is called %s now; its former name is understood for one version", former, name
    )


def is_model(annotation: object) -> TypeGuard[type[BaseModel]]:
    """Whether a type annotation is a model; to Python 3.10, ``list[str]`` is a type as well."""
    return (
        isinstance(annotation, type)
        and get_origin(annotation) is None
        and issubclass(annotation, BaseModel)
    )


def flat_fields(group: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, FieldInfo]]:
    """Name, with its groups in dots, and declaration of every parameter in a group."""
    for name, info in group.model_fields.items():
        if is_model(info.annotation):
            yield from flat_fields(info.annotation, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", info


def former_names(group: type[BaseModel], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Former and present name, with groups in dots, of every renamed parameter in a group."""
    for former, name in getattr(group, "renamed", {}).items():
        yield f"{prefix}{former}", f"{prefix}{name}"
    for name, info in group.model_fields.items():
        if is_model(info.annotation):
            yield from former_names(info.annotation, f"{prefix}{name}.")


def flat_values(model: BaseModel) -> dict[str, Any]:
    """Values of a model by names with dots."""
    values: dict[str, Any] = {}
    for name in type(model).model_fields:
        value = getattr(model, name)
        if isinstance(value, BaseModel):
            values |= {f"{name}.{key}": inner for key, inner in flat_values(value).items()}
        else:
            values[name] = value
    return values


def nested_values(values: dict[str, Any]) -> dict[str, Any]:
    """Undo `flat_values`."""
    content: dict[str, Any] = {}
    for name, value in values.items():
        *groups, last = name.split(".")
        place = content
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = value
    return content


def is_among(name: str, names: frozenset[str]) -> bool:
    """Whether a parameter, or the group that it is in, is among `names`."""
    return name in names or name.partition(".")[0] in names


def unit_of(info: FieldInfo) -> str:
    """Unit of a parameter; empty for a pure number."""
    extra = info.json_schema_extra
    return str(extra.get("unit", "")) if isinstance(extra, dict) else ""


def bounds_of(info: FieldInfo) -> dict[str, Any]:
    """Bounds of a parameter: ``ge``, ``gt``, ``le`` and ``lt``, as far as they are set."""
    return {
        kind: getattr(constraint, kind)
        for constraint in info.metadata
        for kind in ("ge", "gt", "le", "lt")
        if getattr(constraint, kind, None) is not None
    }


def constraints_of(info: FieldInfo) -> str:
    """Bounds or choices of a parameter in words; empty if there are none."""
    choices = getattr(info.annotation, "__args__", ())
    if choices and all(isinstance(choice, str) for choice in choices):
        return "one of " + ", ".join(choices)
    signs = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
    return ", ".join(f"{signs[kind]} {value:g}" for kind, value in bounds_of(info).items())
