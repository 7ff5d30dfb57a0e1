"""The command line ``usmap``: parse, one call, print.

Commands import what they need when they run, so that ``usmap --help`` comes at once.
"""

import signal
import sys
from pathlib import PurePath

# First of all: importing takes half a second, in which Python would answer Ctrl-C with pages.
# `main` takes it back.
_program = PurePath(sys.argv[0])
_is_program = _program.name == "usmap" or _program.parts[-2:] == ("usmap_ros", "__main__.py")
if _is_program and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from usmap_ros.cli.app import main  # noqa: E402 - it takes half a second

__all__ = ["main"]
