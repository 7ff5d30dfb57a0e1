"""What is written down in several places says the same."""

import re
from collections.abc import Iterator
from importlib.metadata import requires
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import usmap_ros

PYTHONS = ["3.10", "3.11", "3.12", "3.13"]


def requirements(*extras: str) -> Iterator[Requirement]:
    """List the requirements of the package with some extras."""
    for line in requires("usmap_ros") or []:
        requirement = Requirement(line)
        wanted = requirement.marker is None or any(
            requirement.marker.evaluate({"extra": extra}) for extra in extras
        )
        if wanted:
            yield requirement


def pins(path: Path, python: str) -> dict[str, str]:
    """Read the versions a constraints file gives for a Python version."""
    result = {}
    for line in path.read_text().splitlines():
        if line and not line.startswith("#"):
            pin = Requirement(line)
            if pin.marker is None or pin.marker.evaluate({"python_version": python}):
                (specifier,) = pin.specifier
                assert specifier.operator == "==", line
                result[canonicalize_name(pin.name)] = specifier.version
    return result


def test_versions_agree(root):
    manifests = [root / "package.xml", root / "msg_schemas/package.xml"]
    versions = {str(path): ElementTree.parse(path).findtext("version") for path in manifests}
    for path in [root / "setup.py", root / "msg_schemas/pyproject.toml"]:
        versions[str(path)] = re.search(r'^ *version ?= ?"(.*)"', path.read_text(), re.M)[1]
    versions["CITATION.cff"] = yaml.safe_load((root / "CITATION.cff").read_text())["version"]
    versions["usmap_ros"] = usmap_ros.__version__

    assert len(set(versions.values())) == 1, versions


@pytest.mark.parametrize("python", PYTHONS)
def test_constraints_pin_every_requirement(root, python):
    pinned = pins(root / "constraints.txt", python)

    for requirement in requirements("dev", "ros"):
        version = pinned[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(version), f"{requirement} is pinned to {version}"


@pytest.mark.parametrize("python", PYTHONS)
def test_lower_bounds_are_those_of_setup_py(root, python):
    lowest = pins(root / "test/packaging/lower-bounds.txt", python)

    assert {canonicalize_name(requirement.name) for requirement in requirements()} == set(lowest)
    for requirement in requirements():
        version = lowest[canonicalize_name(requirement.name)]
        assert requirement.specifier.contains(version), f"{requirement} is tested with {version}"


def test_lower_bounds_are_exact_for_the_oldest_python(root):
    lowest = pins(root / "test/packaging/lower-bounds.txt", PYTHONS[0])

    for requirement in requirements():
        (bound,) = requirement.specifier
        assert lowest[canonicalize_name(requirement.name)].startswith(bound.version), requirement
