"""Feed the program with wrong inputs, and see that it says what is wrong with each.

    python tools/fuzz --count 1000 [--seed N] [--kinds trace,cone]

Whatever is not an error of the project's own, in one short line, is a finding: other exceptions,
warnings, more than five seconds of a core, more than a gigabyte.  Exit status 1 if there are any.
"""

from __future__ import annotations

import argparse
import logging
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from kinds import Kind, all_kinds

from usmap_ros.errors import UsmapError

LIMIT_S, LIMIT_BYTES, LONGEST_MESSAGE = 5.0, 2**30, 1000


class TooLongError(BaseException):
    """An input took more than `LIMIT_S`; no handler in the program catches it."""


def main() -> None:
    """Run the inputs that the command line asks for, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=1000, help="inputs of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", default="", help="names, with commas; all if left out")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    arguments = parser.parse_args()
    wanted = set(filter(None, arguments.kinds.split(",")))
    found: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        kinds = [kind for kind in all_kinds(Path(folder)) if not wanted or kind.name in wanted]
        prepare(kinds)
        for kind in kinds:
            started = time.monotonic()
            refused = 0
            for number in range(arguments.first, arguments.first + arguments.count):
                outcome = run(kind, arguments.seed, number)
                refused += outcome == "refused"
                if outcome and outcome != "refused":
                    key = f"{kind.name}: {outcome}"
                    if not found[key]:
                        print(f"  input {number}: {key}", flush=True)
                    found[key] += 1
            seconds = time.monotonic() - started
            print(
                f"{kind.name}: {arguments.count} inputs, {refused} refused,"
                f" {sum(n for key, n in found.items() if key.startswith(kind.name + ':'))}"
                f" findings, {seconds:.0f} s",
                flush=True,
            )
    for key, count in found.most_common():
        print(f"{count:6d} {key}")
    sys.exit(1 if found else 0)


def prepare(kinds: list[Kind]) -> None:
    """Bound time and memory; what is compiled or imported once must not count for one input."""
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("error")
    signal.signal(signal.SIGPROF, _too_long)
    for kind in kinds:
        run(kind, 0, 0, limit_s=120.0)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * resource.getpagesize() + LIMIT_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


def run(kind: Kind, seed: int, number: int, limit_s: float = LIMIT_S) -> str:
    """Try one input: nothing, ``refused``, or what went wrong and where."""
    generator = np.random.default_rng([seed, number, sum(map(ord, kind.name))])
    signal.setitimer(signal.ITIMER_PROF, limit_s)
    try:
        kind.attempt(generator)
    except UsmapError as error:
        text = str(error)
        if len(text) > LONGEST_MESSAGE or "\n" in text:
            return f"a message of {len(text)} characters: {text[:60]!r}"
        return "refused"
    except TooLongError as error:
        return f"too long {_place(error)}"
    except Exception as error:
        return f"{type(error).__name__} {_place(error)}: {str(error)[:100]}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return ""


def _too_long(number: int, frame: object) -> None:
    raise TooLongError


def _place(error: BaseException) -> str:
    """Last line of the project's own code, and the one that raised."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "usmap_ros" in frame.filename] or frames
    places = [f"{Path(frame.filename).name}:{frame.lineno}" for frame in (own[-1], frames[-1])]
    return "at " + " < ".join(dict.fromkeys(places))


if __name__ == "__main__":
    main()
