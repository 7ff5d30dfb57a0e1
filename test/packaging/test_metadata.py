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
            requirement.marker.evaluate({"extra": extra}) for extra in ("", *extras)
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


#: Found in code as imports, or as types of messages and services.
ROS_IMPORT = re.compile(r"^\s*(?:from|import) (\w+)", re.M)
ROS_TYPE = re.compile(r"[\"'](\w+)/(?:msg|srv)/\w+[\"']")
#: Of ROS, among what Python code imports; types of messages are of ROS in any case.
ROS_PACKAGES = re.compile(
    r"^(ament_index_python|launch\w*|rcl\w*|tf2_\w+|\w+_(msgs|interfaces|srvs))$"
)


def test_package_xml_names_every_ros_package_that_is_used(root):
    files = [*(root / "src/usmap_ros").rglob("*.py"), *(root / "launch").glob("*.py")]
    texts = [path.read_text(encoding="utf-8") for path in files]
    used = {name for text in texts for name in ROS_IMPORT.findall(text) if ROS_PACKAGES.match(name)}
    used |= {name for text in texts for name in ROS_TYPE.findall(text)}
    named = {
        element.text
        for element in ElementTree.parse(root / "package.xml").iter()
        if element.tag.endswith("depend")
    }
    assert {"rcl_interfaces", "ament_index_python", "rclpy"} <= used
    assert used <= named


def test_the_versions_of_ubuntu_are_allowed(root):
    pinned = pins(root / "test/packaging/ubuntu-24.04.txt", "3.12")
    allowed = {canonicalize_name(one.name): one.specifier for one in requirements("test")}
    for name, version in pinned.items():
        assert name not in allowed or allowed[name].contains(version), name
    assert {"numpy", "scipy", "pillow", "pytest"} <= pinned.keys()
