"""The Python interface is what docs/python.md shows, and works as it stands there."""

import doctest
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

import usmap_ros
from usmap_ros.errors import BagError

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
POLE, RECORDING = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)


def test_the_example_finds_its_pole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(POLE, "docs/python.md", "exec"), names)
    shown = capsys.readouterr().out
    cells_m = np.array([line.strip(" []").split() for line in shown.splitlines()], dtype=float)
    assert 1 <= len(cells_m) <= 6
    assert np.hypot(*(cells_m - [1.5, 1.2]).T).max() < 0.15
    assert {path.name for path in (tmp_path / "pole_map").iterdir()} == {
        "map.npz", "map.pgm", "map.yaml",
    }  # fmt: skip
    assert (tmp_path / "pole_map.png").stat().st_size > 10_000


def test_the_example_is_short() -> None:
    code = [line for line in POLE.splitlines() if line.strip() and not line.startswith("#")]
    assert len(code) <= 25


def test_a_recording_is_mapped_and_scored_in_a_few_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)
    exec(compile(RECORDING, "docs/python.md", "exec"), {})
    f1, known = (float(word) for word in capsys.readouterr().out.split())
    assert f1 > 0.6
    assert known > 0.1


def test_every_name_is_explained_on_the_page_and_in_its_docstring() -> None:
    table = PAGE.split("## What there is")[1]
    for name in usmap_ros.__all__:
        assert f"`{name}`" in table, name
        assert inspect.getdoc(getattr(usmap_ros, name)), name
    named = {word for row in re.findall(r"^\| (`.*?`) \|", table, re.M) for word in row.split(", ")}
    assert {name.strip("`") for name in named} == set(usmap_ros.__all__)


def test_every_name_is_used_by_an_example_or_a_test() -> None:
    used = set(
        re.findall(r"usmap_ros\.(\w+)", POLE + RECORDING + Path(__file__).read_text("utf-8"))
    )
    assert used >= set(usmap_ros.__all__)


def test_what_the_type_checker_sees_is_what_there_is() -> None:
    source = inspect.getsource(usmap_ros)
    for_checker = source.split("if TYPE_CHECKING:")[1].split("__version__")[0]
    imported = re.findall(r"from (\S+) import (.*)", for_checker)
    pairs = {(name, module) for module, names in imported for name in names.split(", ")}
    assert {name for name, _ in pairs} == set(usmap_ros.__all__)
    for name, module in pairs:
        assert getattr(importlib.import_module(module), name) is getattr(usmap_ros, name)
    assert set(usmap_ros.__all__) <= set(dir(usmap_ros))


def test_a_name_that_there_is_not_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        # That mypy sees it too is as it should be.
        _ = usmap_ros.nothing  # type: ignore[attr-defined]


def test_importing_it_imports_nothing_else() -> None:
    script = (
        "import sys, usmap_ros\n"
        "print([name for name in sys.modules if name.startswith(('usmap_ros.', 'numpy', 'rclpy'))])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    # What offers the names, and loads nothing before one is asked for.
    assert done.stdout == "['usmap_ros.lazy_names']\n"


@pytest.mark.parametrize("module", ["usmap_ros", "usmap_ros.simulation.points"])
def test_examples_in_docstrings_hold(module: str) -> None:
    results = doctest.testmod(importlib.import_module(module))
    assert results.attempted > 0
    assert results.failed == 0


def trace(**changes: object) -> usmap_ros.EchoTrace:
    given: dict[str, object] = {
        "pose": usmap_ros.Pose.planar(0.0, 0.0, 0.0),
        "transducer": usmap_ros.hear([]).transducer,
        "channel": usmap_ros.Channel(343.0),
    }
    # Wrong types are what some of the changes are about.
    return usmap_ros.EchoTrace.from_signal(
        **({"signal": np.zeros(400), "sample_rate_hz": 25e3} | given | changes)  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("signal", "is_envelope", "encoding"),
    [
        (np.full(400, 1.0 - 2.0j), False, usmap_ros.Encoding.IQ),
        (np.full(400, 0.5), False, usmap_ros.Encoding.RAW),
        (np.full(400, 0.5), True, usmap_ros.Encoding.ENVELOPE),
    ],
)
def test_a_trace_of_an_array_has_its_signal(
    signal: np.ndarray, is_envelope: bool, encoding: usmap_ros.Encoding
) -> None:
    made = trace(signal=signal, is_envelope=is_envelope)
    assert made.encoding is encoding
    np.testing.assert_array_equal(made.signal(), signal)


def test_an_array_that_makes_no_trace_is_refused() -> None:
    with pytest.raises(usmap_ros.UsmapError, match="sample_rate"):
        trace(sample_rate_hz=0.0)


def test_a_recording_is_read_as_it_was_written(tmp_path: Path) -> None:
    pings = [("/robot1/echo", usmap_ros.hear([(1.0 + 0.1 * n, 0.0)], seed=n)) for n in range(3)]
    assert usmap_ros.write_bag(tmp_path / "bag", pings) == 3
    read = list(usmap_ros.read_bag(tmp_path / "bag"))
    assert [topic for topic, _ in read] == ["/robot1/echo"] * 3
    for (_, kept), (_, made) in zip(read, pings, strict=True):
        np.testing.assert_array_equal(kept.samples, made.samples)
    with pytest.raises(BagError, match="exists already"):
        usmap_ros.write_bag(tmp_path / "bag", pings)


def test_cones_alone_are_no_traces(tmp_path: Path) -> None:
    from usmap_ros.io.bag_writer import new_bag

    with new_bag(tmp_path / "bag") as writer:
        writer.write_cone("/cone", usmap_ros.Pipeline().reconstruct(usmap_ros.hear([(1.0, 0.0)])))
    with pytest.raises(BagError, match="cones only"):
        list(usmap_ros.read_bag(tmp_path / "bag"))


def test_maps_pings_and_cones_can_be_drawn() -> None:
    before = dict(mpl.rcParams)
    pipeline = usmap_ros.Pipeline()
    ping = usmap_ros.hear([(1.0, 0.0)])
    cone = pipeline.process(ping)
    for what in (ping, cone, pipeline.occupancy_map()):
        assert usmap_ros.draw(what).get_axes() or usmap_ros.draw(what).subfigs
    assert dict(mpl.rcParams) == before


def two_points() -> usmap_ros.Scenario:
    return usmap_ros.Scenario.from_mapping(
        {
            "duration_s": 3.0,
            "world": {"points": [{"x_m": 1.5, "y_m": 0.3}, {"x_m": 0.9, "y_m": -0.6}]},
            "robots": [
                {"name": "robot1",
                 "motion": {
                    "kind": "waypoints", "waypoints_m": [[0.0, -1.0], [0.0, 1.0]],
                    "heading_rad": -1.2,
                 }}
            ],
        },
        "two_points.yaml",
    )  # fmt: skip


def test_a_map_is_loaded_as_it_was_saved(tmp_path: Path) -> None:
    pipeline = usmap_ros.Pipeline()
    for _, ping in usmap_ros.simulate(two_points()):
        assert isinstance(pipeline.process(ping), usmap_ros.EchoCone)
    occupancy = pipeline.occupancy_map()
    assert isinstance(occupancy, usmap_ros.OccupancyMap)
    usmap_ros.save_map(tmp_path / "new" / "map", occupancy)
    loaded, _ = usmap_ros.load_map(tmp_path / "new" / "map")
    np.testing.assert_array_equal(loaded.log_odds, occupancy.log_odds)
    assert isinstance(
        usmap_ros.load_truth(tmp_path / "new" / "map" / "map.yaml"), usmap_ros.TruthMap
    )


def test_a_scenario_is_tried_in_one_line() -> None:
    parameters = usmap_ros.PipelineParameters.model_validate({"mapping": {"resolution_m": 0.04}})
    tried = usmap_ros.try_scenario(two_points(), parameters)
    assert tried.occupancy.geometry.resolution_m == tried.truth.geometry.resolution_m == 0.04
    assert tried.score.predicted_cells > 0
    assert tried.score == usmap_ros.score(tried.occupancy, tried.truth, tried.views)
    assert tried.range_only_score.f1 <= 1.0
