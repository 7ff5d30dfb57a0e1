"""What a user is told of what is wrong with all pings."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from pings_among_poles import circle, cone, heard, poles
from typer.testing import CliRunner

from usmap_ros.cli.app import app
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.numerics.geometry import Pose

#: What ranges are told to be, over what they are.
TOO_LONG = 1.03


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a recording of two robots that take sound for faster than it is."""
    path = tmp_path_factory.mktemp("fast") / "bag"
    with new_bag(path) as writer:
        for number, (x_m, y_m, yaw_rad) in enumerate(circle(160).tolist()):
            for robot, aside_m in enumerate((0.0, 0.5)):
                pose = Pose.planar(x_m + aside_m, y_m - aside_m, yaw_rad)
                ranges_m = [TOO_LONG * range_m for range_m in heard(pose, poles())]
                made = cone(pose, ranges_m, 250_000_000 * number + robot)
                name = f"robot{robot + 1}"
                writer.write_cone(f"/{name}/cone", replace(made, child_frame_id=f"{name}/sonar"))
    return path


@pytest.mark.parametrize("corrects", [True, False])
def test_it_is_said_what_is_wrong_with_all_pings(bag: Path, tmp_path: Path, corrects: bool) -> None:
    setting = f"mapping.correct_common_errors={str(corrects).lower()}"
    output = tmp_path / "map"
    done = CliRunner().invoke(app, ["map", str(bag), "-o", str(output), "--set", setting])
    assert done.exit_code == 0
    said = [line for line in done.stderr.splitlines() if "sound is slower" in line]
    error = json.loads((output / "summary.json").read_text())["common_error"]
    assert error["late_m"] == error["poses_late_s"] == 0.0
    if corrects:
        assert len(said) == 1
        assert error["scale"] == pytest.approx(1.0 / TOO_LONG, abs=0.01)
    else:
        assert not said
        assert error["scale"] == 1.0
