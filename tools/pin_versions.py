"""Write constraints.txt: the newest version of everything, for all supported Python versions.

Give it one interpreter for each version, each with a pip that knows ``--report`` (22.2 or later)::

    python tools/pin_versions.py python3.10 python3.11 python3.12 python3.13
"""

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
EXTRAS = "dev,ros"
HEADER = """\
# Exact versions for reproducible environments: pip install -c constraints.txt .
# Written by tools/pin_versions.py; setup.py says what is really required.
"""
# Not pinned: the package itself, and what only builds need, some of them older than the newest.
SKIPPED = {"usmap-ros", "empy", "pip", "setuptools", "wheel"}


def resolve(python: str) -> tuple[str, dict[str, str]]:
    """Return an interpreter's version, and the version of every package pip would install."""
    command = [python, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed"]
    process = subprocess.run(
        [*command, "--report", "-", f"{ROOT}[{EXTRAS}]"],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    report = json.loads(process.stdout)
    packages = [item["metadata"] for item in report["install"]]
    pins = {item["name"].lower().replace("_", "-"): item["version"] for item in packages}
    return report["environment"]["python_version"], pins


def lines(pins: dict[str, dict[str, str]]) -> list[str]:
    """Return the lines for pins by Python version, with markers where the versions differ."""
    pythons = sorted(pins, key=lambda version: int(version.split(".")[1]))
    result = []
    for name in sorted(set().union(*pins.values()) - SKIPPED):
        users: dict[str, list[str]] = {}
        for python in pythons:
            if name in pins[python]:
                users.setdefault(pins[python][name], []).append(python)
        for version, which in users.items():
            result.append(f"{name}=={version}" + (marker(which, pythons) if len(users) > 1 else ""))
    return result


def marker(which: list[str], pythons: list[str]) -> str:
    """Return the environment marker for some of the Python versions."""
    if which == pythons[-len(which) :]:
        return f' ; python_version >= "{which[0]}"'
    if which == pythons[: len(which)]:
        return f' ; python_version <= "{which[-1]}"'
    return " ; " + " or ".join(f'python_version == "{python}"' for python in which)


if __name__ == "__main__":
    resolved = dict(resolve(python) for python in sys.argv[1:])
    (ROOT / "constraints.txt").write_text(HEADER + "\n".join(lines(resolved)) + "\n")
