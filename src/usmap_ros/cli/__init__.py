"""The command line ``usmap``: parse, one call, print.

Commands import what they need when they run, so that ``usmap --help`` comes at once.
"""

from __future__ import annotations

from usmap_ros.cli.app import main

__all__ = ["main"]
