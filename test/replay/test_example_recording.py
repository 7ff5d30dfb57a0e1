"""The recording in bags/ can be remade from its scenario, and maps."""

from pathlib import Path

import pytest

from usmap_ros.evaluation.scoring import score
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.map_files import load_truth
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.runs.offline import map_bag
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation.recording import simulate
from usmap_ros.simulation.scenario import Scenario

BAGS = Path(__file__).parents[2] / "bags"


def test_it_is_small() -> None:
    size = sum(path.stat().st_size for path in (BAGS / "yard").iterdir())
    assert size < 2_000_000


def test_its_scenario_makes_the_same_pings_again(tmp_path: Path) -> None:
    """Up to rounding: mathematical libraries differ in the last bit from machine to machine."""
    again = list(simulate(Scenario.load(BAGS / "yard.yaml")))
    with BagReader([BAGS / "yard"]) as bag:
        recorded = list(bag.traces())
    assert [topic for topic, _ in recorded] == [topic for topic, _ in again]
    for (_, kept), (_, made) in zip(recorded, again, strict=True):
        assert kept.stamp_ns == made.stamp_ns
        assert kept.samples == pytest.approx(made.samples, abs=1e-6)


def test_the_same_scenario_gives_the_same_file_twice(tmp_path: Path) -> None:
    contents = []
    for name in ("first", "second"):
        with new_bag(tmp_path / name, compression="zstd") as writer:
            for topic, trace in simulate(Scenario.load(BAGS / "yard.yaml")):
                writer.write_trace(topic, trace)
        (recording,) = (tmp_path / name).glob("*.mcap")
        contents.append(recording.read_bytes())
    assert contents[0] == contents[1]


def test_it_maps() -> None:
    pipeline = Pipeline()
    with BagReader([BAGS / "yard"]) as bag:
        run = map_bag(bag, pipeline, RobotPaths())
        assert bag.skipped.total == 0
    assert run.pings == 180
    result = score(pipeline.occupancy_map(), load_truth(BAGS / "yard_truth.yaml"))
    assert result.precision > 0.75, result
    assert result.recall > 0.6, result


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_a_cut_recording_keeps_its_share(tmp_path: Path, share: float) -> None:
    (original,) = (BAGS / "yard").glob("*.mcap")
    content = original.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: int(share * len(content))])
    with BagReader([BAGS / "yard"]) as whole:
        pings = whole.trace_count
    with BagReader([tmp_path / "cut.mcap"]) as bag:
        # Chunks hold about twenty pings.
        assert bag.trace_count == pytest.approx(share * pings, abs=25)
        order = [(trace.stamp_ns, topic) for topic, trace in bag.traces()]
    assert order == sorted(order)
