"""``usmap plan``: from where to ping next."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from usmap_ros.cli import console

if TYPE_CHECKING:
    from usmap_ros.acoustics.transducer import Transducer
    from usmap_ros.pings.robot_paths import RobotPaths


def plan(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that 'usmap map' wrote.")],
    count: Annotated[
        int, typer.Option("--count", "-n", min=1, metavar="N", help="How many poses to name.")
    ] = 5,
    half_angle: Annotated[
        float | None,
        typer.Option(metavar="RAD", min=0.01, max=math.pi, help="Of the cone that would ping."),
    ] = None,
    max_range: Annotated[
        float | None, typer.Option(metavar="M", min=0.1, max=1000.0, help="How far it listens.")
    ] = None,
    limit: Annotated[
        float, typer.Option(metavar="AMPLITUDE", min=1e-6, help="Above which an echo is heard.")
    ] = 0.02,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Picture: .png, .pdf or .svg."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the poses as JSON.")] = False,
) -> None:
    """Name the poses from which a ping is expected to settle most of what is undecided."""
    from dataclasses import asdict

    from usmap_ros.errors import MapFileError
    from usmap_ros.io.map_files import load_map
    from usmap_ros.mapping.next_view import best_views, candidate_poses

    occupancy, paths = load_map(folder)
    transducer = _transducer(folder, paths, half_angle, max_range)
    try:
        poses = candidate_poses(occupancy)
        views = best_views(occupancy, poses, transducer, count, limit_amplitude=limit)
    except ValueError as error:
        raise MapFileError(folder, str(error)) from error
    if output is not None:
        from usmap_ros.plotting.style import save_figure
        from usmap_ros.plotting.views import views_figure

        save_figure(views_figure(occupancy, views, transducer.beam.half_angle_rad), output)
    if as_json:
        typer.echo(json.dumps([asdict(view) for view in views], indent=2))
        return
    if not views:
        typer.echo(f"{folder}: no ping is expected to settle anything")
        return
    console.print_table(
        f"{folder}: best of {len(poses)} poses", ["x (m)", "y (m)", "heading (rad)", "score"],
        [[f"{v.x_m:.2f}", f"{v.y_m:.2f}", f"{v.yaw_rad:.2f}", f"{v.score:.2f}"] for v in views],
    )  # fmt: skip


def _transducer(
    folder: Path, paths: RobotPaths, half_angle: float | None, max_range: float | None
) -> Transducer:
    """What would ping: as asked for, or else like the last ping in the map."""
    from usmap_ros.acoustics.beam import BeamPattern
    from usmap_ros.acoustics.pulse import Pulse, PulseShape
    from usmap_ros.acoustics.transducer import Transducer
    from usmap_ros.errors import MapFileError
    from usmap_ros.pings.fields_of_view import Beam

    # An unknown beam is nothing but NaN.
    known = [beam for beams in paths.beams.values() for beam in beams if beam[0] == beam[0]]
    if known:
        last = Beam(*known[-1])
        half_angle = half_angle or last.half_angle_rad
        max_range = max_range or last.max_range_m
    if half_angle is None or max_range is None:
        raise MapFileError(folder, "has no pings; state --half-angle and --max-range")
    # Planning asks for the beam and the ranges only.
    pulse = Pulse(PulseShape.HANN_BURST, 50e3, 3e-4)
    return Transducer(pulse, BeamPattern.linear(half_angle), 0.0, max_range)
