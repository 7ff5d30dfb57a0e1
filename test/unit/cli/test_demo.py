"""The demo, on the scenario that is shipped for it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from usmap_ros.io.bag_reader import BagReader
from usmap_ros.runs.demo_map import FRAMES_AFTER


@pytest.mark.slow
def test_the_demo_does_the_main_job(usmap: Callable[..., Any], tmp_path: Path) -> None:
    # What an earlier run has left gives way.
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo/map.png").write_bytes(b"old")
    done = usmap("demo", "-o", "demo", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""

    folder = tmp_path / "demo"
    for name in ("bag", "map.yaml", "map.npz", "truth.yaml", "map.png", "ping.png", "map.gif"):
        assert (folder / name).exists()
        assert f"demo/{name}" in done.stdout
    assert "range-only sonar" in done.stdout
    with BagReader([folder / "bag"]) as bag:
        assert len({topic.name for topic in bag.topics}) >= 3
        assert json.loads((folder / "summary.json").read_text())["pings"] == bag.trace_count
    with Image.open(folder / "map.gif") as animation:
        assert animation.n_frames == len(FRAMES_AFTER) + 1
    with Image.open(folder / "map.png") as picture:
        picture.verify()
