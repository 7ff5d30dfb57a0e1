"""The whole study: every picture, and ``paper.json`` with the numbers behind them."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from usmap_ros.errors import FileError, file_errors
from usmap_ros.io.atomic import write_atomically
from usmap_ros.paper.choosing_cells import choosing_a_cell
from usmap_ros.paper.coefficients import kinds_of_coefficients
from usmap_ros.paper.figure_1 import single_robot, two_robots
from usmap_ros.paper.figure_8_range import range_of_the_caption
from usmap_ros.paper.figures_2_3 import beam_patterns, sensing_matrix
from usmap_ros.paper.figures_4_to_6 import four_paths, reconstruction, scene_and_pulse_train
from usmap_ros.paper.figures_7_8 import interference, two_matrices
from usmap_ros.paper.floor_calibration import mismatched_floor
from usmap_ros.paper.off_grid import residual_and_f1
from usmap_ros.paper.part import Part
from usmap_ros.paper.sampling import grid_size_against_rate
from usmap_ros.paper.solver_study import phase_transition, table
from usmap_ros.paper.symmetry import two_transducers
from usmap_ros.paper.walls import walls_and_an_object
from usmap_ros.plotting.style import save_figure

#: The study's parts, in the order of the paper.
PARTS: tuple[Callable[[], Part], ...] = (
    single_robot,
    two_robots,
    beam_patterns,
    sensing_matrix,
    scene_and_pulse_train,
    reconstruction,
    four_paths,
    interference,
    two_matrices,
    range_of_the_caption,
    two_transducers,
    choosing_a_cell,
    kinds_of_coefficients,
    grid_size_against_rate,
    mismatched_floor,
    residual_and_f1,
    walls_and_an_object,
    table,
    phase_transition,
)
#: Where the numbers go.
NUMBERS_FILE = "paper.json"


def run_study(folder: Path, done: Callable[[], None] = lambda: None) -> dict[str, Any]:
    """Make every picture and write the numbers behind them.

    Parameters
    ----------
    folder : path
        Where the pictures and ``paper.json`` go; made if missing.
    done : callable
        Called after each of `PARTS`.

    Returns
    -------
    dict
        What ``paper.json`` holds: the numbers of each part by its name, and ``seconds``.

    Raises
    ------
    FileError
        If the folder or a file in it cannot be written.
    """
    started = time.perf_counter()
    with file_errors(FileError, folder, "made"):
        folder.mkdir(parents=True, exist_ok=True)
    numbers: dict[str, Any] = {}
    for part in PARTS:
        result = part()
        numbers[result.name] = result.numbers
        save_figure(result.figure, folder / f"{result.name}.png")
        done()
    numbers["seconds"] = time.perf_counter() - started
    path = folder / NUMBERS_FILE
    with file_errors(FileError, path):
        write_atomically(path, (json.dumps(numbers, indent=2) + "\n").encode())
    return numbers
