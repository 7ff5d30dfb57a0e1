"""Recordings that others made map as they should.

They lie in a folder ``shared`` beside the checkout, or where USMAP_SHARED says.
"""

import os
from pathlib import Path

import pytest

from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.map_files import RobotPaths, load_truth
from usmap_ros.mapping.scoring import score
from usmap_ros.offline import map_bag
from usmap_ros.pipeline import Pipeline

SHARED = Path(os.environ.get("USMAP_SHARED", Path(__file__).parents[3] / "shared")) / "bags"

pytestmark = [
    pytest.mark.skipif(not SHARED.is_dir(), reason=f"no recordings in {SHARED}"),
    pytest.mark.slow,
]

PINGS = {
    "poles": 300,
    "poles_envelope": 180,
    "poles_floor": 180,
    "poles_pose_error": 300,
    "poles_raw": 40,
    "sandbox": 480,
}
#: What the F1 score within one cell must reach at the default settings.
LEAST_F1 = {"poles": 0.92, "poles_floor": 0.85, "poles_pose_error": 0.80, "sandbox": 0.80}


@pytest.mark.parametrize("name", PINGS)
def test_every_trace_is_read_in_order(name: str) -> None:
    with BagReader([SHARED / name]) as bag:
        order = [(trace.stamp_ns, topic) for topic, trace in bag.traces()]
        assert bag.skipped.total == 0
    assert len(order) == PINGS[name]
    assert order == sorted(order)


@pytest.mark.parametrize("name", PINGS)
def test_it_maps(name: str) -> None:
    pipeline = Pipeline()
    with BagReader([SHARED / name]) as bag:
        run = map_bag(bag, pipeline, RobotPaths())
    assert run.pings == PINGS[name]
    result = score(pipeline.occupancy_map(), load_truth(SHARED / f"{name}_truth.yaml"))
    assert result.f1 >= LEAST_F1.get(name, 0.6), result


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_a_cut_recording_keeps_its_share(tmp_path: Path, share: float) -> None:
    content = (SHARED / "poles" / "poles.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: int(share * len(content))])
    with BagReader([tmp_path / "cut.mcap"]) as bag:
        assert bag.trace_count == pytest.approx(share * PINGS["poles"], abs=3)
