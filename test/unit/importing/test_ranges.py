"""Recordings made of a table of ranges."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from usmap_ros.cli.app import app
from usmap_ros.errors import ConfigurationError, FileError
from usmap_ros.importing import imported_ranges
from usmap_ros.io.bag_reader import BagReader

TABLE = """time_s,x_m,y_m,yaw_rad,front,left
100.0,0.0,1.0,0.0,1.5,
100.1,0.1,1.0,0.1,inf,0.8
100.2,0.2,1.0,0.2,0,0.9
"""
DESCRIPTION = {
    "ranges": "log.csv",
    "sensors": {"front": {"x_m": 0.1}, "left": {"y_m": 0.1, "yaw_rad": np.pi / 2}},
    "field_of_view_rad": 0.26,
    "min_range_m": 0.02,
    "max_range_m": 4.0,
}


def described(folder: Path, table: str = TABLE, **change: object) -> Path:
    (folder / "log.csv").write_text(table, encoding="utf-8")
    path = folder / "ranges.yaml"
    path.write_text(yaml.safe_dump(DESCRIPTION | change), encoding="utf-8")
    return path


def test_a_table_becomes_cones_where_the_sensors_were(tmp_path: Path) -> None:
    cones = [cone for _, cone in imported_ranges(described(tmp_path))]

    # Nothing measured, and zero, say nothing; infinity says that nothing was there.
    names = [(cone.child_frame_id, len(cone.ranges_m)) for cone in cones]
    front, left = "robot1/front", "robot1/left"
    assert names == [(front, 1), (front, 0), (left, 1), (left, 1)]
    assert cones[0].ranges_m == pytest.approx([1.5])
    assert cones[0].pose.position_m == pytest.approx([0.1, 1.0, 0.0])
    assert cones[2].stamp_ns == 100_100_000_000
    assert cones[2].pose.yaw_rad == pytest.approx(0.1 + np.pi / 2)


def test_command_makes_a_recording_that_maps(tmp_path: Path) -> None:
    run, bag = CliRunner().invoke, tmp_path / "bag"
    done = run(app, ["import", str(described(tmp_path, frame_id="robot1/odom")), "-o", str(bag)])
    assert done.exit_code == 0, done.output
    assert done.stdout == f"{bag}: 4 pings\n"
    with BagReader([bag]) as reader:
        assert {cone.frame_id for _, cone in reader.cones()} == {"robot1/odom"}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"table": TABLE.replace("1.5", "150").replace("0.8", "80")}, "centimetres"),
        ({"table": TABLE.replace(",0.2,0,", ",90,0,")}, "degrees"),
        ({"field_of_view_rad": 15.0}, "field_of_view_rad"),
        ({"sensors": {"front": {}, "left": {}, "right": {}}}, "has no column 'right'"),
        ({"sensors": {"front": {}}}, "has a column 'left'"),
    ],
)
def test_what_cannot_be_meant_is_said(tmp_path: Path, change: dict[str, str], said: str) -> None:
    with pytest.raises((ConfigurationError, FileError), match=said):
        list(imported_ranges(described(tmp_path, **change)))
