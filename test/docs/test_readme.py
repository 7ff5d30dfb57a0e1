"""What the README shows works as it stands there."""

import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from usmap_ros.nodes.program import NODE_NAMES

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```sh\n(.*?)```", README, flags=re.DOTALL)
COMMANDS = [
    line.split(" #")[0].strip() for block in BLOCKS for line in block.splitlines() if line.strip()
]
OFFLINE = [command for command in COMMANDS if command.startswith("usmap ")]


@pytest.fixture(scope="module")
def workplace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder like a fresh clone, as far as the commands need it."""
    folder = tmp_path_factory.mktemp("readme")
    shutil.copytree(ROOT / "bags", folder / "bags")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("command", OFFLINE)
def test_an_offline_command_does_its_work(
    command: str, usmap: Callable[..., Any], workplace: Path
) -> None:
    """In the order of the README: later commands use what earlier ones made."""
    arguments = shlex.split(command)
    finished = usmap(*arguments[1:], cwd=workplace)
    assert finished.returncode == 0, finished.stderr
    if "-o" in arguments:
        assert (workplace / arguments[arguments.index("-o") + 1]).exists()


def test_the_make_targets_it_names_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    named = {command.split()[1] for command in COMMANDS if command.startswith("make ")}
    named |= set(re.findall(r"`make ([a-z-]+)`", README))
    assert named >= {"demo", "test"}
    for target in named:
        assert re.search(rf"^{target}:", makefile, flags=re.MULTILINE), target


def test_the_nodes_and_files_it_names_exist() -> None:
    setup = (ROOT / "setup.py").read_text(encoding="utf-8")
    for node in re.findall(r"ros2 run usmap_ros (\w+)", README):
        assert node in setup, node
    for launch_file in re.findall(r"ros2 launch usmap_ros (\S+)", README):
        assert (ROOT / "launch" / launch_file).is_file(), launch_file
    for link in re.findall(r"\]\((?!https?:)([^)#]+)\)", README):
        assert (ROOT / link).exists(), link


def test_its_table_of_nodes_has_them_all() -> None:
    table = README.split("| node | in → out |")[1].split("\n\n")[0]
    assert sorted(re.findall(r"^\| `(\w+)` \|", table, flags=re.MULTILINE)) == sorted(NODE_NAMES)


def test_its_first_screen_shows_commands_picture_and_ros() -> None:
    first_screen = "\n".join(README.splitlines()[:35])
    for needed in ("make demo", "make test", ".png)", "colcon build", "ros2 run", "ros2 launch"):
        assert needed in first_screen, needed


def test_its_table_of_scores_is_filled_in() -> None:
    table = README.split("<!-- scores -->")[1].split("<!-- /scores -->")[0]
    assert table.count("\n|") >= 6
