"""Whatever dictionary and solver are set, every way of mapping a recording obeys them alike."""

import json
import subprocess
import sys
from itertools import islice
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from usmap_ros.cli.app import app
from usmap_ros.grids import OccupancyMap
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.bags import read_bag
from usmap_ros.io.map_files import load_map
from usmap_ros.parameters import MappingParameters, PipelineParameters, ReconstructionParameters
from usmap_ros.parameters.pipeline import SolverName
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.trial import try_traces
from usmap_ros.simulation import Scenario, record

YARD = Path(__file__).parents[2] / "bags" / "yard"
CHIRPS = Path(__file__).parents[2] / "config" / "scenarios" / "chirps.yaml"
#: More than a worker is handed at once.
PINGS = 9
#: Coarse, so that the slowest solver takes milliseconds.
COARSE = {"cell_size_m": 0.6, "sparsity": 6}
METHODS = [("delay", "cosamp"), *(("cells", solver) for solver in get_args(SolverName))]

#: In a process of its own: the tests' may have threads, and then does not fork.
MAP = """
import json, sys
from usmap_ros.cli.app import app
for arguments in json.loads(sys.argv[1]):
    app(arguments, standalone_mode=False)
"""


def settings_of(dictionary: str, solver: str) -> list[str]:
    settings = {"dictionary": dictionary, "solver": solver, **COARSE}
    return [f"--set=reconstruction.{name}={value}" for name, value in settings.items()]


def parameters(dictionary: str, solver: str) -> PipelineParameters:
    return PipelineParameters(
        reconstruction=ReconstructionParameters(dictionary=dictionary, solver=solver, **COARSE),
        mapping=MappingParameters(resolution_m=0.1),
    )


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the first pings of a recording."""
    folder = tmp_path_factory.mktemp("front_door") / "bag"
    with BagReader([YARD]) as whole, new_bag(folder) as writer:
        for topic, trace in islice(whole.traces(), PINGS):
            writer.write_trace(topic, trace)
    return folder


@pytest.fixture(scope="module")
def maps(bag: Path) -> Path:
    """Give a folder with the maps of the command line, by dictionary, solver and jobs."""
    runs = [
        ["map", str(bag), "-o", str(bag.parent / f"{','.join(method)},{jobs}"), "-j", str(jobs),
         "--resolution", "0.1", *settings_of(*method)]
        for method in METHODS
        for jobs in (1, 2)
    ]  # fmt: skip
    command = [sys.executable, "-c", MAP, json.dumps(runs)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return bag.parent


def command_line_map(maps: Path, method: tuple[str, str], jobs: int) -> OccupancyMap:
    return load_map(maps / f"{','.join(method)},{jobs}")[0]


@pytest.mark.parametrize("method", METHODS, ids="-".join)
def test_the_command_line_gives_the_map_of_the_pipeline_with_any_number_of_jobs(
    maps: Path, bag: Path, method: tuple[str, str]
) -> None:
    pipeline = Pipeline(parameters(*method))
    for _, trace in read_bag(bag):
        pipeline.process(trace)
    expected = pipeline.occupancy_map()
    for jobs in (1, 2):
        mapped = command_line_map(maps, method, jobs)
        assert mapped.geometry == expected.geometry
        np.testing.assert_array_equal(mapped.log_odds, expected.log_odds)
        np.testing.assert_array_equal(mapped.observed, expected.observed)


def test_transducers_that_ping_at_once_are_mapped_alike(tmp_path: Path) -> None:
    """By the command line with any number of jobs, and by a trial in Python."""
    scenario = Scenario.load(CHIRPS).model_copy(update={"duration_s": 0.5})
    with new_bag(tmp_path / "bag") as writer:
        record(scenario, writer, lambda: None)
    runs = [
        ["map", str(tmp_path / "bag"), "-o", str(tmp_path / str(jobs)), "-j", str(jobs)]
        for jobs in (1, 2)
    ]
    command = [sys.executable, "-c", MAP, json.dumps(runs)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    alone, shared = (load_map(tmp_path / jobs)[0] for jobs in ("1", "2"))
    tried = try_traces(read_bag(tmp_path / "bag"), scenario.truth_map()).occupancy
    np.testing.assert_array_equal(alone.log_odds, shared.log_odds)
    np.testing.assert_array_equal(alone.log_odds, tried.log_odds)


def test_dictionary_and_solver_change_the_map(maps: Path) -> None:
    default, *others = (command_line_map(maps, method, 1).log_odds.tobytes() for method in METHODS)
    assert default not in others
    # Solvers that agree on the few echoes of so coarse a matrix give the same map, as they should;
    # those with whole numbers find other cells.
    assert len(set(others)) >= 2


def test_the_picture_of_a_ping_shows_what_its_settings_find(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As 'usmap plot' draws it."""
    figures = []
    where = "usmap_ros.plotting.style.save_figure"
    monkeypatch.setattr(where, lambda figure, _: figures.append(figure))
    found = {}
    for method in (("delay", "cosamp"), ("cells", "cosamp")):
        arguments = ["plot", str(bag), "-o", str(tmp_path / "ping.png")]
        app([*arguments, *settings_of(*method)], standalone_mode=False)
        left, _ = figures[-1].subfigs
        (echoes,) = [line for line in left.axes[0].lines if "echo" in str(line.get_label())]
        with BagReader([bag]) as recording:
            cone = Pipeline(parameters(*method)).reconstruct(next(recording.traces())[1])
        np.testing.assert_array_equal(echoes.get_xdata(), cone.ranges_m)
        found[method] = cone.ranges_m
    # The centres of cells are at other ranges than the objects.
    assert not np.array_equal(*found.values())
