"""``usmap calibrate``: what a recording says of its sensors and of the air."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usmap_ros.cli import console
from usmap_ros.cli.parameters import ParametersFile, Settings, pipeline_parameters

if TYPE_CHECKING:
    from usmap_ros.calibration import Calibration, Target
    from usmap_ros.parameters import CorrectionParameters
    from usmap_ros.pings.trace import EchoTrace

_PARAMETER_FILES = (".yaml", ".yml")


def calibrate(
    bags: Annotated[
        list[Path], typer.Argument(metavar="BAG...", help="rosbag2 folders, .mcap or .db3 files.")
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="PATH",
            help="FILE.yaml: write the parameters there instead of printing them; anything else:"
            " record the traces there, set right.",
        ),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y[,REFLECTIVITY[,RADIUS]]",
            help="A known object: where it stands (m), its reflectivity as a point target, and its"
            " radius (m).",
        ),
    ] = None,
    topic: Annotated[
        str | None, typer.Option(metavar="TOPIC", help="Only the traces on this topic.")
    ] = None,
    parameters_file: ParametersFile = None,
    settings: Settings = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print all figures as JSON.")] = False,
    force: Annotated[
        bool, typer.Option("--force", "-f", help="Replace a recording that is there already.")
    ] = False,
) -> None:
    """Find sound speed, floor, range offset and gain from a recording's own echoes."""
    from usmap_ros.calibration import calibrate as calibrated
    from usmap_ros.calibration import report
    from usmap_ros.errors import FileError, file_errors
    from usmap_ros.io.atomic import write_atomically
    from usmap_ros.io.yaml_files import read_mapping

    if force and (output is None or output.suffix in _PARAMETER_FILES):
        raise typer.BadParameter("is for recordings only", param_hint="'--force'")
    parameters = pipeline_parameters(parameters_file, settings)
    console.compile_loops()
    found = calibrated(_traces(bags, topic), parameters, _target(target))
    name = ", ".join(map(str, bags))
    _check_told(name, found)
    for remark in found.remarks:
        typer.echo(f"usmap: warning: {name}: {remark}", err=True)
    text = report.parameter_file(
        found, name, read_mapping(parameters_file) if parameters_file else {}
    )
    if output is not None and output.suffix in _PARAMETER_FILES:
        with file_errors(FileError, output):
            write_atomically(output, text.encode())
    elif output is not None:
        if not found.correction().model_fields_set:
            raise FileError(
                output,
                "would hold the same traces: only the pulse is told, which a .yaml file can hold",
            )
        _record(bags, topic, found.correction(), output, replace=force)
    if as_json:
        typer.echo(json.dumps(report.as_json(found), indent=2))
    elif output is None:
        typer.echo(text, nl=False)
    else:
        facts = report.summary(found)
        console.print_facts(f"{output}: {found.pings} pings, {found.objects} objects", facts)


def _target(text: str | None) -> Target | None:
    from usmap_ros.calibration import Target

    if text is None:
        return None
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    possible = 2 <= len(values) <= 4 and all(map(math.isfinite, values))
    if not possible or min(values[2:], default=1.0) < 0.0 or values[2:3] == [0.0]:
        form = "X,Y[,REFLECTIVITY[,RADIUS]]"
        raise typer.BadParameter(f"{text!r} is not of the form {form}", param_hint="--target")
    return Target(*values)


def _traces(bags: list[Path], topic: str | None) -> Iterator[EchoTrace]:
    from usmap_ros.errors import BagError
    from usmap_ros.io.bag_reader import BagReader

    name, heard = ", ".join(map(str, bags)), 0
    with BagReader(bags) as bag, console.progress("listening", bag.trace_count) as step:
        if not bag.trace_count:
            raise BagError(name, "holds no echo traces, and cones do not tell what is off in them")
        for found, trace in bag.traces():
            step()
            if topic in {None, found}:
                heard += 1
                yield trace
    if not heard:
        raise BagError(name, f"has no usable echo traces on {topic or 'any topic'}")


def _check_told(name: str, found: Calibration) -> None:
    """Raise `BagError` if there is nothing that could be set right."""
    from usmap_ros.calibration.report import summary
    from usmap_ros.errors import BagError

    if not found.tells_something:
        causes = "; ".join(f"{quantity}: {why}" for quantity, why in summary(found).items())
        raise BagError(name, f"tells nothing well enough: {causes}")


def _record(
    bags: list[Path],
    topic: str | None,
    correction: CorrectionParameters,
    output: Path,
    *,
    replace: bool,
) -> None:
    """Record the traces anew, those of `topic` set right."""
    from usmap_ros.io.bag_reader import BagReader
    from usmap_ros.io.bag_writer import new_bag
    from usmap_ros.pings.preparation.prepare import corrected

    with BagReader(bags) as bag, new_bag(output, replace=replace) as writer:
        for found, trace in bag.traces():
            is_meant = topic in {None, found}
            writer.write_trace(found, corrected(trace, correction) if is_meant else trace)
