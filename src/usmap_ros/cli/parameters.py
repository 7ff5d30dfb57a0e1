"""Options for the parameters of reconstruction and mapping, shared by several commands."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from usmap_ros.parameters import PipelineParameters

ParametersFile = Annotated[
    Path | None,
    typer.Option(
        "--parameters", "-p", metavar="FILE.yaml", help="Parameters of reconstruction and mapping."
    ),
]


def complete_setting(incomplete: str) -> list[str]:
    """Parameters whose names begin like this, as a shell completes them."""
    from usmap_ros.parameters import PipelineParameters
    from usmap_ros.parameters.fields import flat_fields

    names = (f"{name}=" for name, _ in flat_fields(PipelineParameters))
    return [name for name in names if name.startswith(incomplete)]


Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Set one parameter, such as mapping.resolution_m=0.1; may be repeated.",
        autocompletion=complete_setting,
    ),
]


def with_short_options(
    settings: list[str] | None, options: Mapping[str, tuple[str, object]]
) -> list[str]:
    """Settings as --set takes them, with those that have an option of their own.

    Parameters
    ----------
    settings : list of str, optional
        What --set was given.
    options : mapping of str to (str, object)
        By the name of an option: the parameter it is short for, and its value; None if not given.

    Raises
    ------
    typer.BadParameter
        If a parameter is set in both ways: one of them would do nothing.
    """
    joined = list(settings or [])
    keys = {text.partition("=")[0].strip() for text in joined}
    for option, (key, value) in options.items():
        if value is not None and key in keys:
            raise typer.BadParameter(f"{key} is set by --set as well", param_hint=f"'{option}'")
        joined += [] if value is None else [f"{key}={value}"]
    return joined


def pipeline_parameters(file: Path | None, settings: list[str] | None) -> PipelineParameters:
    """Parameters from a file, with single ones set on the command line on top.

    Raises
    ------
    ConfigurationError
        If the file is unusable.
    typer.BadParameter
        If a setting is: that is wrong usage.
    """
    from usmap_ros.errors import ConfigurationError
    from usmap_ros.io.yaml_files import read_mapping, validated
    from usmap_ros.parameters import PipelineParameters

    content = read_mapping(file) if file else {}
    parameters = validated(file or "defaults", PipelineParameters, content)
    for setting in settings or []:
        _apply(content, setting)
    if settings:
        try:
            parameters = validated("command line", PipelineParameters, content)
        except ConfigurationError as error:
            raise typer.BadParameter(error.cause) from error
    return parameters


def _apply(content: dict[str, Any], setting: str) -> None:
    """Put one ``group.key=value`` into the nested `content`."""
    from usmap_ros.io.yaml_text import YamlTextError, parse_yaml

    key, separator, text = setting.partition("=")
    *groups, name = key.strip().split(".")
    try:
        value = parse_yaml(text)
    except YamlTextError as error:
        raise typer.BadParameter(f"{setting!r} has no value that could be read") from error
    if not separator or not name:
        raise typer.BadParameter(f"{setting!r} is not of the form KEY=VALUE")
    for group in groups:
        content = content.setdefault(group, {})
        if not isinstance(content, dict):
            raise typer.BadParameter(f"{group!r} in {key!r} is no group of parameters")
    content[name] = value
