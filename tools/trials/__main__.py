"""Try fleets that start and stop, nodes that are killed, replays, and faulty robots.

    python tools/trials fleets [--count 50] [--at-once 3] [--robots 4]
    python tools/trials kills [--count 100]
    python tools/trials replays [--rates 0.5 1 5 50]
    python tools/trials faults [--scenes poles rough smooth] [--seeds 1 2 3] [--no-maps]
    python tools/trials soak [--minutes 60] [--robots 10]

Exit status 1 if anything was lost, hung, unreadable, different, or ended in a traceback; of
faults, if one costs more than is asked for, or without maps if a healthy robot is accused; of the
soak, if anything of it stays.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from pathlib import Path
from typing import NoReturn

from faults import FAULTS, LIAR, SCENES, try_faults, try_names
from soak import try_soak

#: What ends a trial before it is through.
ENDINGS = (signal.SIGINT, signal.SIGTERM)


def _arguments() -> argparse.Namespace:
    """What the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    trials = parser.add_subparsers(dest="trial", required=True)
    fleets = trials.add_parser("fleets", help="start and stop 'usmap fleet'")
    fleets.add_argument("--count", type=int, default=50, help="fleets in all")
    fleets.add_argument("--at-once", type=int, default=3)
    fleets.add_argument("--robots", type=int, default=4, help="of each fleet")
    kills = trials.add_parser("kills", help="kill -9 map_fusion and bag_recorder")
    kills.add_argument("--count", type=int, default=100)
    replays = trials.add_parser("replays", help="compare replays with 'usmap map'")
    replays.add_argument("--rates", type=float, nargs="+", default=[0.5, 1.0, 5.0, 50.0])
    faults = trials.add_parser("faults", help="map with one faulty robot of three")
    faults.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    faults.add_argument(
        "--faults",
        nargs="*",
        choices=(*FAULTS, LIAR),
        default=[*FAULTS, LIAR],
        help="without any name: healthy robots alone, whether one is accused",
    )
    faults.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    faults.add_argument("--pings", type=int, default=60, help="of each robot")
    faults.add_argument(
        "--within",
        type=float,
        default=None,
        help="most that a fault may cost of F1 or known, against the two other robots alone; by"
        " default 1",
    )
    faults.add_argument(
        "--no-maps",
        action="store_true",
        help="only see who is named, which takes a fraction of the time",
    )
    soak = trials.add_parser("soak", help="one fault after another, injected and cleared")
    soak.add_argument("--faults", nargs="+", choices=FAULTS, default=list(FAULTS))
    soak.add_argument("--minutes", type=float, default=60.0, help="of the robots' time")
    soak.add_argument("--robots", type=int, default=10)
    soak.add_argument("--seed", type=int, default=1)
    for trial in (fleets, kills):
        trial.add_argument("--seed", type=int, default=1)
        trial.add_argument(
            "--patience",
            type=float,
            default=10.0,
            metavar="S",
            help="longest that an ending may take, and a tenth of it what may be lost beyond an"
            " interval; more on a machine that has other things to do",
        )
    arguments = parser.parse_args()
    if arguments.trial == "faults" and arguments.no_maps and arguments.within is not None:
        faults.error("--within asks what maps lose, and --no-maps makes none")
    return arguments


def main() -> None:
    """Run the trial that the command line asks for, and print its figures."""
    arguments = _arguments()
    for number in ENDINGS:
        signal.signal(number, _end)
    with tempfile.TemporaryDirectory() as folder:
        # Each is imported when it is asked for: faults need no ROS.
        if arguments.trial == "fleets":
            from fleets import try_fleets

            figures, troubles = try_fleets(
                Path(folder),
                arguments.count,
                arguments.at_once,
                arguments.robots,
                arguments.seed,
                arguments.patience,
            )
        elif arguments.trial == "replays":
            from replays import try_replays

            figures, troubles = try_replays(Path(folder), arguments.rates)
        elif arguments.trial == "faults" and arguments.no_maps:
            figures, troubles = try_names(
                arguments.scenes, arguments.faults, arguments.seeds, arguments.pings
            )
        elif arguments.trial == "faults":
            figures, troubles = try_faults(
                Path(folder),
                arguments.scenes,
                arguments.faults,
                arguments.seeds,
                arguments.pings,
                1.0 if arguments.within is None else arguments.within,
            )
        elif arguments.trial == "soak":
            figures, troubles = try_soak(
                arguments.faults, arguments.minutes, arguments.robots, arguments.seed
            )
        else:
            from kills import try_kills

            figures, troubles = try_kills(
                Path(folder), arguments.count, arguments.seed, 0.1 * arguments.patience
            )
    for name, value in figures.items():
        print(f"{name}: {value}")
    for trouble in troubles:
        print(f"TROUBLE {trouble}")
    sys.exit(1 if troubles else 0)


def _end(number: int, _frame: object) -> NoReturn:
    """End what was started, remove its folder, and then end; asking again changes nothing."""
    for ending in ENDINGS:
        signal.signal(ending, signal.SIG_IGN)
    sys.exit(128 + number)


if __name__ == "__main__":
    main()
