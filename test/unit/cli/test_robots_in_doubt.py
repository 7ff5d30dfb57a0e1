"""What a user is told of robots that are not believed."""

from dataclasses import replace
from pathlib import Path

import pytest
from pings_among_poles import circle, cone, heard, poles
from typer.testing import CliRunner

from usmap_ros.cli.app import app
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.numerics.geometry import Pose


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a recording of three robots, one of which repeats its first ping while it moves."""
    path = tmp_path_factory.mktemp("robots") / "bag"
    with new_bag(path) as writer:
        for number, real in enumerate(circle(40)):
            pose = Pose.planar(*map(float, real))
            for robot in ("robot1", "robot2", "stuck"):
                stamp_ns = 250_000_000 * number + len(robot)
                ranges_m = [1.0, 2.0] if robot == "stuck" else heard(pose, poles())
                made = cone(pose, ranges_m, stamp_ns)
                writer.write_cone(f"/{robot}/cone", replace(made, child_frame_id=f"{robot}/sonar"))
    return path


@pytest.mark.parametrize(("weighs", "counts"), [(True, "for nothing"), (False, "all the same")])
def test_it_is_said_whether_pings_of_a_suspect_count(
    bag: Path, tmp_path: Path, weighs: bool, counts: str
) -> None:
    setting = f"mapping.weigh_robots={str(weighs).lower()}"
    done = CliRunner().invoke(app, ["map", str(bag), "-o", str(tmp_path / "map"), "--set", setting])
    assert done.exit_code == 0
    (said,) = [line for line in done.stderr.splitlines() if "/stuck/cone" in line]
    assert "stuck" in said
    assert f"its pings count {counts}; --without /stuck/cone leaves it out" in said
