"""Transducers that ping at once, live: from the driver to cones with bearings."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rclpy.serialization import serialize_message

from usmap_ros.io.conversions import array_from_cdr, cone_from_cdr
from usmap_ros.nodes.cone_reconstructor import ConeReconstructor
from usmap_ros.nodes.echo_driver import EchoDriver

CHIRP = {"shape": "chirp", "carrier_hz": 50_000.0, "duration_s": 0.002}
RECEIVER = {"encoding": "iq", "sample_rate_hz": 30_000.0, "noise_std": 0.003}
STILL = {"turn_std_rad": 0.0}


def scenario(path: Path) -> Path:
    """Write a scenario of one robot with two transducers and a pole to the left of its axis."""
    pair = [
        {
            "name": name,
            "mount": {"y_m": y_m},
            "pulse": {**CHIRP, "sweep_hz": sweep_hz},
            "receiver": RECEIVER,
        }
        for name, y_m, sweep_hz in (("left", 0.06, 16e3), ("right", -0.06, -16e3))
    ]
    robot = {
        "name": "bat",
        "motion": {"kind": "random_walk", "start": [0.0, 0.0, 0.0], "speed_m_s": 0.0} | STILL,
        "simultaneous": True,
        "transducers": pair,
        "pose_error": {"position_std_m": 0.05},
    }
    world = {"area_m": [-1, 3, -1, 1], "points": [{"x_m": 1.5, "y_m": 0.4}]}
    path.write_text(yaml.safe_dump({"world": world, "robots": [robot]}))
    return path


def test_two_chirps_at_once_become_cones_with_bearings(live: Any, tmp_path: Path) -> None:
    cones = {
        name: live.listen("usmap_msgs/msg/EchoCone", f"/bat/{name}/cone", 50)
        for name in ("left", "right")
    }
    live.add(ConeReconstructor, namespace="bat", transducers=["left", "right"])
    path = scenario(tmp_path / "bat.yaml")
    live.add(EchoDriver, namespace="bat", scenario=str(path), ping_rate_hz=10.0)
    live.until(lambda: min(len(found) for found in cones.values()) > 2)

    for name, y_m in (("left", 0.06), ("right", -0.06)):
        cone = cone_from_cdr(serialize_message(cones[name][-1]))
        np.testing.assert_allclose(cone.ranges_m, [np.hypot(1.5, 0.4 - y_m)], atol=2e-3)
        assert cone.bearings_rad is not None
        np.testing.assert_allclose(cone.bearings_rad, [np.arctan2(0.4 - y_m, 1.5)], atol=0.03)
    # They pinged at once, and share the error of their robot's pose.
    left, right = (
        {c.stamp_ns: c for c in map(cone_from_cdr, map(serialize_message, cones[n]))} for n in cones
    )
    for stamp_ns in left.keys() & right.keys():
        apart = left[stamp_ns].pose.position_m - right[stamp_ns].pose.position_m
        np.testing.assert_allclose(apart, [0.0, 0.12, 0.0], atol=1e-9)
    assert left.keys() & right.keys()


def test_who_comes_late_is_told_of_the_transducers(
    live: Any, tmp_path: Path, nav2_qos: Any
) -> None:
    path = scenario(tmp_path / "bat.yaml")
    live.add(EchoDriver, namespace="bat", scenario=str(path), ping_rate_hz=5.0)
    live.spin(0.2)
    found = live.listen("usmap_msgs/msg/TransducerArray", "/bat/transducers", nav2_qos)
    live.until(lambda: len(found) == 1)

    array = array_from_cdr(serialize_message(found[0]))
    sweeps = [element.transducer.pulse.sweep_hz for element in array.elements]
    assert (array.frame_id, sweeps) == ("bat/base_link", [16e3, -16e3])
