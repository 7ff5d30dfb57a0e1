"""Print what building a package needs, a line each, for pip to install into this environment.

For example::

    python tools/build_requirements.py msg_schemas | pip install -r /dev/stdin

pip would install the same into an environment of its own for each build, ROS 2 included.
"""

import sys
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def build_requirements(package: Path) -> list[str]:
    """Return what the ``pyproject.toml`` in a folder says that its build requires."""
    project = tomllib.loads((package / "pyproject.toml").read_text())
    required: list[str] = project["build-system"]["requires"]
    return required


if __name__ == "__main__":
    print(*build_requirements(Path(sys.argv[1])), sep="\n")
