"""What sensors that measure ranges only make of a scene: readings, and traces made of them.

Such a sensor, of light or of sound, gives the distance of the nearest surface in its beam,
whichever way the surface faces.  Here that is worked out from the scene itself, with an error in
range and readings that miss what is there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.range_cones import RangeReading
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.simulation import Scenario
from usmap_ros.simulation.scene import Scene
from usmap_ros.simulation.simulator import NANOSECONDS, MountedTransducer

FloatArray = NDArray[np.float64]
#: Standard deviation of a range, and as a share of it; how many readings miss what is there.
RANGE_STD_M, RANGE_SHARE, MISSED = 0.005, 0.01, 0.001
#: Rays in a beam, and how wide a thin pole is to them.
_RAYS, _POLE_RADIUS_M = 61, 0.015
#: Of the traces.
_SAMPLE_RATE_HZ, _NOISE_STD = 25_000.0, 0.005


def readings(scenario: Scenario) -> Iterator[tuple[str, Pose, MountedTransducer, RangeReading]]:
    """Topic, pose, sensor and reading of every ping of a scenario, in the order of stamps."""
    scene = scenario.scene()
    rng = np.random.default_rng([scenario.seed, 1])
    pings = []
    for robot in scenario.fleet(scene):
        count = round(scenario.duration_s / robot.ping_interval_s)
        for sensor, first_s in zip(robot.transducers, robot.first_ping_s, strict=True):
            times = first_s + robot.ping_interval_s * np.arange(count)
            pings += [(time_s, sensor.topic, robot, sensor) for time_s in times]
    for time_s, topic, robot, sensor in sorted(pings, key=lambda ping: ping[:2]):
        pose = robot.motion.pose(time_s).compose(sensor.mount)
        transducer = sensor.transducer
        half_angle_rad = transducer.beam.half_angle_rad
        range_m = nearest_m(scene, pose.position_m[:2], pose.yaw_rad, half_angle_rad)
        range_m += rng.normal(0.0, RANGE_STD_M + RANGE_SHARE * min(range_m, 10.0))
        if rng.random() < MISSED or range_m > transducer.max_range_m:
            range_m = transducer.max_range_m
        yield (
            topic,
            pose,
            sensor,
            RangeReading(
                stamp_ns=scenario.start_ns + round(time_s * NANOSECONDS),
                frame_id=sensor.child_frame_id,
                field_of_view_rad=2.0 * half_angle_rad,
                min_range_m=transducer.min_range_m,
                max_range_m=transducer.max_range_m,
                range_m=max(range_m, transducer.min_range_m),
            ),
        )


def range_cones(scenario: Scenario) -> Iterator[tuple[str, EchoCone]]:
    """Every reading as the cone that `cone_reconstructor` makes of ``sensor_msgs/Range``."""
    for topic, pose, _, reading in readings(scenario):
        yield topic, reading.cone(pose, scenario.frame_id)


def range_traces(scenario: Scenario) -> Iterator[tuple[str, EchoTrace]]:
    """Every reading as an envelope that holds one pulse at its range, and noise."""
    rng = np.random.default_rng([scenario.seed, 2])
    for topic, pose, sensor, reading in readings(scenario):
        transducer, channel = sensor.transducer, sensor.stated_channel
        count = int(_SAMPLE_RATE_HZ * sensor.listening_s)
        noise = rng.normal(0.0, _NOISE_STD * np.sqrt(0.5), (2, count))
        signal = noise[0] + 1j * noise[1]
        if reading.range_m < reading.max_range_m:
            delay_s = 2.0 * reading.range_m / channel.sound_speed_m_s
            pulse = transducer.pulse.envelope(np.arange(count) / _SAMPLE_RATE_HZ - delay_s)
            signal += pulse / max(reading.range_m, 0.2) ** 2
        trace = EchoTrace.from_signal(
            np.abs(signal), _SAMPLE_RATE_HZ, pose=pose, transducer=transducer, channel=channel,
            stamp_ns=reading.stamp_ns, noise_std=_NOISE_STD, is_envelope=True,
        )  # fmt: skip
        yield topic, replace(trace, child_frame_id=sensor.child_frame_id)


def first_echoes(
    heard: list[tuple[str, EchoCone]], scenario: Scenario
) -> list[tuple[str, EchoCone]]:
    """The first echo of each cone as the cone of a range reading, none as the greatest range."""
    found = []
    for topic, cone in heard:
        sensor = cone.transducer
        reading = RangeReading(
            cone.stamp_ns, cone.child_frame_id, 2.0 * sensor.beam.half_angle_rad,
            sensor.min_range_m, sensor.max_range_m,
            float(cone.ranges_m[0]) if len(cone.ranges_m) else sensor.max_range_m,
        )  # fmt: skip
        found.append((topic, reading.cone(cone.pose, scenario.frame_id)))
    return found


def nearest_m(scene: Scene, place_m: FloatArray, yaw_rad: float, half_angle_rad: float) -> float:
    """Distance of the nearest surface in a beam, in m; infinite if there is none.

    Parameters
    ----------
    scene : Scene
        What stands there.
    place_m : (2,) array
        Where the sensor is.
    yaw_rad, half_angle_rad : float
        Which way it looks, and how wide.
    """
    angles = yaw_rad + half_angle_rad * np.linspace(-1.0, 1.0, _RAYS)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    return min(_to_walls_m(scene, place_m, rays), _to_discs_m(scene, place_m, rays))


def _to_walls_m(scene: Scene, place_m: FloatArray, rays: FloatArray) -> float:
    along = scene.walls.ends_m - scene.walls.starts_m
    to_start = scene.walls.starts_m - place_m
    # place + u * ray = start + v * along, by Cramer's rule.
    across = _cross(rays[:, np.newaxis], along)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance_m = _cross(to_start, along) / across
        share = _cross(to_start, rays[:, np.newaxis]) / across
    hit = (distance_m > 0.0) & (share >= 0.0) & (share <= 1.0)
    return float(np.min(distance_m, initial=np.inf, where=hit))


def _to_discs_m(scene: Scene, place_m: FloatArray, rays: FloatArray) -> float:
    to_center = scene.discs.centers_m - place_m
    radii_m = np.maximum(scene.discs.radii_m, _POLE_RADIUS_M)
    ahead = rays @ to_center.T
    aside = _cross(rays[:, np.newaxis], to_center)
    depth = radii_m**2 - aside**2
    distance_m = ahead - np.sqrt(np.maximum(depth, 0.0))
    return float(np.min(distance_m, initial=np.inf, where=(depth > 0.0) & (distance_m > 0.0)))


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    product: FloatArray = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return product
