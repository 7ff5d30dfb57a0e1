"""The page on installing names what there is."""

import re
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
SETUP = (ROOT / "setup.py").read_text(encoding="utf-8")


def test_the_versions_it_names_are_those_that_are_required() -> None:
    required = {
        requirement.name.lower(): requirement.specifier
        for requirement in map(
            Requirement, re.findall(r'^        "([\w.]+>=[^"]*)",$', SETUP, re.M)
        )
    }
    named = re.findall(r"'(\w+>=[\d.]+)'", PAGE)
    assert len(named) == 7
    for requirement in map(Requirement, named):
        assert required[requirement.name] == requirement.specifier


def test_extras_and_pythons_are_those_of_the_package() -> None:
    for extra in re.findall(r"'\.\[(\w+)\]'", PAGE):
        assert f'"{extra}": [' in SETUP
    assert 'python_requires=">=3.10"' in SETUP
    assert "Python 3.10 to 3.13" in PAGE


def test_the_readme_leads_to_it() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    section = readme.split("## Install")[1].split("\n## ")[0]
    assert "docs/install.md" in section
    assert "venv" in section


def test_the_message_of_a_missing_package_is_the_programs() -> None:
    source = (ROOT / "src/usmap_ros/live/requirements.py").read_text(encoding="utf-8")
    assert "this command needs ROS 2 Jazzy, and the Python package" in source
    assert "this command needs ROS 2 Jazzy, and the Python package" in PAGE
