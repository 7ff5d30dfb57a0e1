"""The program ``usmap``: its commands, and the one place where errors end."""

import signal
import sys
from typing import Annotated

import typer

import usmap_ros
from usmap_ros.cli import (
    calibrate,
    compile,
    console,
    demo,
    evaluate,
    fleet,
    import_,
    info,
    map,
    merge,
    paper,
    plan,
    plot,
    record,
    replay,
    simulate,
    status,
    walls,
)
from usmap_ros.errors import UsmapError
from usmap_ros.processes.cores import keep_linear_algebra_to_one_core
from usmap_ros.processes.memory import look_for_garbage_rarely
from usmap_ros.processes.threads import take_short_turns

app = typer.Typer(
    name="usmap",
    help="Multi-robot occupancy mapping from in-air ultrasound.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("demo")(demo.demo)
app.command("simulate")(simulate.simulate)
app.command("import")(import_.import_files)
app.command("calibrate")(calibrate.calibrate)
app.command("map")(map.map_bags)
app.command("merge")(merge.merge)
app.command("evaluate")(evaluate.evaluate)
app.command("walls")(walls.walls)
app.command("plot")(plot.plot)
app.command("plan")(plan.plan)
app.command("info")(info.info)
app.command("paper")(paper.paper)
app.command("fleet")(fleet.fleet)
app.command("status")(status.status)
app.command("replay")(replay.replay)
app.command("record")(record.record)
app.command("compile")(compile.compile_loops)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"usmap {usmap_ros.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    verbose: Annotated[
        int, typer.Option("--verbose", "-v", count=True, help="Say what is done; -vv: in detail.")
    ] = 0,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    """Set up what all commands share."""
    console.set_up_logging(verbose)


def _end(number: int, frame: object) -> None:
    """Unwind, so that nothing half-made stays behind; asking again does not disturb that."""
    for asked in (signal.SIGINT, signal.SIGTERM):
        signal.signal(asked, signal.SIG_IGN)
    sys.exit(128 + number)


def main() -> None:
    """Run the command line; the only place where errors of usmap_ros are caught for good.

    Exit status 1: the data or a file was unusable. 2: wrong usage, which typer sees to. 130 and
    143: the process was asked to end by SIGINT or SIGTERM.
    """
    keep_linear_algebra_to_one_core()
    look_for_garbage_rarely()
    take_short_turns()
    is_program = signal.getsignal(signal.SIGINT) is signal.SIG_DFL
    if is_program:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    before = signal.signal(signal.SIGTERM, _end)
    try:
        app(prog_name=app.info.name)
    except UsmapError as error:
        console.print_error(str(error))
        sys.exit(1)
    except KeyboardInterrupt:
        # Before a command had begun, or after it.
        sys.exit(128 + signal.SIGINT)
    finally:
        signal.signal(signal.SIGTERM, before)
        if is_program:
            # All is done; asked to end while it ends, Python would have something to say.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
