"""Whatever dictionary and solver are set, every way of mapping a recording obeys them alike."""

import subprocess
import sys
from importlib.util import find_spec
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import PolyCollection

from usmap_ros.cli.plot import ping_figure
from usmap_ros.grids import OccupancyMap
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.map_files import load_map
from usmap_ros.parameters import MappingParameters, PipelineParameters, ReconstructionParameters
from usmap_ros.pipeline import Pipeline

YARD = Path(__file__).parents[2] / "bags" / "yard"
PINGS = 12
#: Coarse, so that the slowest solver takes milliseconds.
COARSE = {"cell_size_m": 0.4, "sparsity": 8}
#: Dictionary, solver, and the package that the solver needs.
METHODS = [
    ("delay", "cosamp", "numpy"),
    ("cells", "cosamp", "numpy"),
    ("cells", "omp", "sklearn"),
    ("cells", "l1", "sklearn"),
    ("cells", "tv", "pylops"),
    ("cells", "nnls", "numpy"),
    ("cells", "integer", "numpy"),
    ("cells", "binary", "numpy"),
]
AVAILABLE = [method[:2] for method in METHODS if find_spec(method[2])]

#: In a process of its own: the tests' may have threads, and then does not fork.
MAP = """
import sys
from usmap_ros.cli.app import app

bag, folder, *methods = sys.argv[1:]
for method in methods:
    dictionary, solver = method.split(",")
    for jobs in ("1", "2"):
        arguments = ["map", bag, "-o", f"{{folder}}/{{method}},{{jobs}}", "-j", jobs]
        for setting in (
            f"dictionary={{dictionary}}", f"solver={{solver}}", "cell_size_m={cell_size_m}",
            "sparsity={sparsity}",
        ):
            arguments += ["--set", f"reconstruction.{{setting}}"]
        app([*arguments, "--resolution", "0.1"], standalone_mode=False)
""".format(**COARSE)


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
    methods = [",".join(method) for method in AVAILABLE]
    command = [sys.executable, "-c", MAP, str(bag), str(bag.parent), *methods]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return bag.parent


def command_line_map(maps: Path, method: tuple[str, str], jobs: int) -> OccupancyMap:
    return load_map(maps / f"{','.join(method)},{jobs}")[0]


@pytest.mark.parametrize("jobs", [1, 2])
@pytest.mark.parametrize("method", AVAILABLE, ids="-".join)
def test_the_command_line_gives_the_map_of_the_pipeline(
    maps: Path, bag: Path, method: tuple[str, str], jobs: int
) -> None:
    pipeline = Pipeline(parameters(*method))
    with BagReader([bag]) as recording:
        for _, trace in recording.traces():
            pipeline.process(trace)
    expected, mapped = pipeline.occupancy_map(), command_line_map(maps, method, jobs)
    assert mapped.geometry == expected.geometry
    np.testing.assert_array_equal(mapped.log_odds, expected.log_odds)
    np.testing.assert_array_equal(mapped.observed, expected.observed)


def test_dictionary_and_solver_change_the_map(maps: Path) -> None:
    default, *others = (
        command_line_map(maps, method, 1).log_odds.tobytes() for method in AVAILABLE
    )
    assert default not in others
    # Some solvers agree on some traces, as they should.
    assert len(set(others)) >= 4


def test_the_picture_of_a_ping_shows_what_its_settings_find(bag: Path) -> None:
    found = {}
    for method in (("delay", "cosamp"), ("cells", "cosamp")):
        chosen = parameters(*method)
        left, _ = ping_figure(bag, 0, chosen, None).subfigs
        upper = left.axes[0]
        (echoes,) = [line for line in upper.lines if "echo" in str(line.get_label())]
        with BagReader([bag]) as recording:
            cone = Pipeline(chosen).reconstruct(next(recording.traces())[1])
        np.testing.assert_array_equal(echoes.get_xdata(), cone.ranges_m)
        assert any(isinstance(drawn, PolyCollection) for drawn in upper.collections)
        found[method] = cone.ranges_m
    # The centres of cells are at other ranges than the objects.
    assert not np.array_equal(*found.values())
