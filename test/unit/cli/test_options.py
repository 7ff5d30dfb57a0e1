"""No option is accepted that would do nothing, and every option is tried by some test."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer.main
from PIL import Image

from usmap_ros.cli.app import app

Run = Callable[..., Any]
TESTS = Path(__file__).parents[2]
COMMANDS: dict[str, Any] = typer.main.get_group(app).commands  # type: ignore[attr-defined]
OPTIONS = [
    (name, parameter.opts)
    for name, command in COMMANDS.items()
    for parameter in command.params
    if parameter.param_type_name == "option" and "--help" not in parameter.opts
]
MAP = ("map", "bag", "-o", "again")
EVALUATE = ("evaluate", "map", "--truth", "truth.yaml")

#: What is given for nothing, and what the one line says.
IDLE = {
    "a reach, where all beams are known": (
        (*EVALUATE, "--max-range", "3"),
        "'--max-range': map holds the beams of all its pings",
    ),
    "further looks, by a method that takes each ping up once": (
        (*MAP, "--method", "additive", "--passes", "2"),
        "'--passes': mapping.method: additive has no use for more passes",
    ),
    "a robot to leave out that is not there": (
        (*MAP, "--without", "ghost"),
        "'--without': 'ghost' is nobody's name here; there are /robot1/echo",
    ),
    "a robot to leave out that is in none of many recordings": (
        ("map", "bags", "-o", "again", "-j", "1", "--without", "ghost"),
        "'--without': 'ghost' is nobody's name here; there are /robot1/echo",
    ),
    "processes, where a cluster has its own": (
        (*MAP, "--jobs", "3", "--scheduler", "tcp://nobody:1"),
        "'--jobs': is up to the cluster's workers",
    ),
    "tiles of a single recording, which is mapped as a whole": (
        (*MAP, "--tile", "20"),
        "'--tile': goes with folders of recordings, or a --scheduler",
    ),
    "a method in two ways": (
        (*MAP, "--method", "additive", "--set", "mapping.method=joint"),
        "'--method': mapping.method is set by --set as well",
    ),
    "cells in two ways": (
        (*MAP, "--resolution", "0.1", "--set", "mapping.resolution_m=0.2"),
        "'--resolution': mapping.resolution_m is set by --set as well",
    ),
    "a parameter that joining maps does not ask for": (
        ("merge", "map", "map", "-o", "whole", "--set", "reconstruction.solver=omp"),
        "'--set': 'reconstruction.solver=omp' changes nothing",
    ),
    "a ping of a map": (("plot", "map", "-o", "x.png", "--ping", "1"), "'--ping': is for record"),
    "parameters for drawing a map": (
        ("plot", "map", "-o", "x.png", "--set", "mapping.resolution_m=0.1"),
        "'--set': is for recordings only",
    ),
    "a layer of a bag": (("plot", "bag", "-o", "x.png", "--layer", "ambiguity"), "'--layer': is"),
    "an extent of a bag": (
        ("plot", "bag", "-o", "x.png", "--extent", "0,1,0,1"),
        "'--extent': is for maps only",
    ),
    "force, for a file of parameters": (
        ("calibrate", "bag", "-o", "air.yaml", "--force"),
        "'--force': is for recordings only",
    ),
}


def plain(text: str) -> str:
    """Text without the frame that wrong usage is shown in."""
    return " ".join(re.sub(r"\x1b\[[0-9;]*m|[│╭╮╰╯─]", " ", text).split())


@pytest.mark.parametrize("what", IDLE)
def test_an_option_that_would_do_nothing_is_wrong_usage(
    usmap: Run, workspace: Path, what: str
) -> None:
    arguments, message = IDLE[what]
    if "bags" in arguments:
        (workspace / "bags").mkdir()
        (workspace / "bag").rename(workspace / "bags" / "bag")
    done = usmap(*arguments, cwd=workspace)
    assert done.returncode == 2
    assert message in plain(done.stderr)
    assert "Traceback" not in done.stderr


def test_a_reach_for_a_map_without_pings_is_wrong_usage(usmap: Run, workspace: Path) -> None:
    arrays = dict(np.load(workspace / "map" / "map.npz"))
    for name in [name for name in arrays if name.startswith("path_")]:
        del arrays[name]
    (workspace / "bare").mkdir()
    np.savez(workspace / "bare" / "map.npz", **arrays)
    arguments = ("evaluate", "bare", "--truth", "truth.yaml", "--max-range", "3")
    done = usmap(*arguments, cwd=workspace)
    assert done.returncode == 2
    assert "'--max-range': bare holds no pings" in plain(done.stderr)


def test_every_option_is_tried_by_some_test() -> None:
    sources = [path.read_text(encoding="utf-8") for path in TESTS.rglob("test_*.py")]
    untried = [
        f"{command} {names[0]}"
        for command, names in OPTIONS
        if not any(
            f'"{command}"' in text and any(f'"{name}"' in text for name in names)
            for text in sources
        )
    ]
    assert untried == []


def test_walls_have_the_length_that_is_asked_for(usmap: Run, workspace: Path) -> None:
    cells = np.full((40, 40), 254, np.uint8)
    cells[5, 2:38] = cells[30, 2:14] = 0
    # A file, or the folder of a map that has one.
    folder = workspace / "plan"
    folder.mkdir()
    Image.fromarray(cells).save(folder / "plan.pgm")
    text = (
        "image: {}plan.pgm\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.25\n"
    )
    (workspace / "plan.yaml").write_text(text.format("plan/"))
    (folder / "map.yaml").write_text(text.format(""))
    found = [
        usmap("walls", plan, "-o", "w.yaml", "--least-length", length, cwd=workspace).stdout
        for plan, length in (("plan.yaml", "0.3"), ("plan", "1.0"))
    ]
    assert found == ["w.yaml: 2 walls of 0.3 m or more\n", "w.yaml: 1 walls of 1 m or more\n"]


def test_what_hears_nothing_settles_nothing(usmap: Run, undecided: Path) -> None:
    asked = ("plan", "map", "-n", "1", "--limit")
    assert len(json.loads(usmap(*asked, "0.02", "--json", cwd=undecided).stdout)) == 1
    assert json.loads(usmap(*asked, "1000", "--json", cwd=undecided).stdout) == []
    shown = usmap(*asked, "1000", cwd=undecided)
    assert shown.stdout == "map: no ping is expected to settle anything\n"
    assert shown.returncode == 0


def test_joined_maps_obey_a_file_of_parameters(usmap: Run, workspace: Path) -> None:
    (workspace / "small.yaml").write_text("mapping: {most_cells: 1000}\n")
    shutil.copytree(workspace / "map", workspace / "twin")
    done = usmap("merge", "map", "twin", "-o", "all", "--parameters", "small.yaml", cwd=workspace)
    assert done.returncode == 1
    assert "may have 1e+03 (mapping.most_cells)" in done.stderr


@pytest.mark.parametrize("target", ["1,2,x", "1", "1,2,0", "1,2,3,-4", "nan,1"])
def test_a_target_of_another_form_is_wrong_usage(usmap: Run, workspace: Path, target: str) -> None:
    done = usmap("calibrate", "bag", "--target", target, cwd=workspace)
    assert done.returncode == 2
    assert "is not of the form X,Y[,REFLECTIVITY[,RADIUS]]" in plain(done.stderr)


def test_a_hundred_processes_a_core_are_wrong_usage(usmap: Run, workspace: Path) -> None:
    done = usmap("map", "bag", "-o", "many", "-j", "3000", cwd=workspace)
    assert done.returncode == 2
    assert "3000 processes are more than" in done.stderr
    assert not (workspace / "many").exists()
