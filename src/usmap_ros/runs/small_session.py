"""A session in small, in parts: together they run every inner loop there is.

Two robots turn in a room of smooth walls with a pole in it, for long enough that mirrors, columns
and what all pings have in common are looked for.  What each ping hears follows from geometry, so
that nothing is simulated or reconstructed where that is not what is to be compiled.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.evaluation.line_of_sight import pings_in_sight
from usmap_ros.mapping.joint.estimate import JointEstimate
from usmap_ros.mapping.joint.free_space.open_rays import likely_as_anything
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.joint.leave_one_out import kept_pings
from usmap_ros.mapping.joint.surfaces.surface_lines import surface_lines
from usmap_ros.mapping.joint.telling_pings import are_surprises
from usmap_ros.mapping.joint.visibility.field import field_around
from usmap_ros.mapping.joint.visibility.ray_casting import RAYS, STEPS
from usmap_ros.mapping.next_view import best_views, candidate_poses
from usmap_ros.mapping.robot_check.consistency import Consistency
from usmap_ros.numerics.geometry import Pose, wrapped
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone, encode_limits
from usmap_ros.pings.fields_of_view import PingViews
from usmap_ros.pings.trace import Encoding
from usmap_ros.runs.pipeline import Pipeline

#: Walls of the room, by direction of the normal and distance from the origin, and the pole in it.
WALLS = ((0.0, 4.0), (0.5 * math.pi, 3.0), (math.pi, 0.0), (1.5 * math.pi, 0.0))
POLE_M = 2.6, 1.1
#: Pings of each robot; of those a first live map is made of half, and a second of so many more.
PINGS, LATER_PINGS = 60, 5
#: Where on their way robots begin, rad, and how far they turn as they go round once.
ROBOTS = {"one": (0.0, 3.0), "other": (2.0, -4.0)}
#: Pings of a place that nothing is known of.
FEW_PINGS = 10


def reconstruct_all_kinds() -> None:
    """Reconstruct a ping of each encoding, and one with several paths to each object."""
    # Here, because none but the processes that compile need a simulator.
    from usmap_ros.simulation.points import AIR, RECEIVER, hear

    pipeline = Pipeline()
    raw = replace(RECEIVER, encoding=Encoding.RAW, sample_rate_hz=250_000.0)
    envelope = replace(RECEIVER, encoding=Encoding.ENVELOPE)
    floor = Channel(343.0, floor_height_m=0.3, floor_reflectivity=0.5)
    for receiver, channel in ((RECEIVER, AIR), (RECEIVER, floor), (envelope, AIR), (raw, AIR)):
        pipeline.reconstruct(hear([(1.5, 0.2), (2.5, -0.3)], receiver=receiver, channel=channel))


def reconstruct_complex_pulse() -> None:
    """Reconstruct a ping whose pulse is complex, for which all is compiled once more.

    So are chirps, and all pulses that were learnt from I and Q.
    """
    from usmap_ros.simulation.points import TRANSDUCER, hear

    chirp = Pulse(PulseShape.CHIRP, 50_000.0, 0.001, sweep_hz=5_000.0)
    Pipeline().reconstruct(hear([(1.5, 0.2)], transducer=replace(TRANSDUCER, pulse=chirp)))


def map_pings() -> None:
    """Map pings while they come and together, compare robots, and see what was in sight of them."""
    parameters, cones = MappingParameters(), _session()
    fusion, consistency = JointFusion(parameters), Consistency(parameters)
    for number, (source, cone) in enumerate(cones):
        fusion.fuse(cone, source)
        consistency.add(source, cone)
        if number in (len(cones) // 2, len(cones) // 2 + LATER_PINGS):
            fusion.live_snapshot()()
    occupancy = fusion.occupancy_map()
    views = PingViews.of(cone for _, cone in cones)
    pings_in_sight(occupancy.observed, occupancy.geometry, views)
    consistency.findings()


def find_free_space() -> None:
    """Ask what is free, before anything is known of what stands: what mapping does last.

    And whether pings heard what is likely by that.
    """
    parameters, cones = MappingParameters(), [cone for _, cone in _session()[:FEW_PINGS]]
    pings = kept_pings({"": cones}, parameters).pings()
    field = field_around(pings.table, pings.rows, parameters.resolution_m)
    estimate = JointEstimate(pings.table, pings.rows, pings.weights, pings.echoes, field)
    known = estimate.known(*estimate.free_space(estimate.walls()), estimate.belief(), {})
    are_surprises(pings, known, parameters)
    # Two objects are no wall, and where nothing is known no part of a place is like no other.
    surface_lines(np.zeros((1, 9)), np.ones((1, 9), np.bool_), 2.0)
    count = len(pings.rows)
    left, shares = np.zeros((count, RAYS, STEPS), np.uint8), np.zeros(count, np.float32)
    likely_as_anything(pings.table, pings.rows, field, left, shares, 0.0)


def plan_views() -> None:
    """Ask where to look next."""
    from usmap_ros.simulation.points import TRANSDUCER

    pipeline = Pipeline()
    for _, cone in _session()[:FEW_PINGS]:
        pipeline.fuse(cone)
    occupancy = pipeline.occupancy_map()
    best_views(occupancy, candidate_poses(occupancy), TRANSDUCER, 1)


def refine_odometry() -> None:
    """Correct the poses of a robot that drifts."""
    from usmap_ros.localisation.refine import refine_poses

    way = [("/one/echo", cone) for source, cone in _session() if source == "one"]
    refine_poses(way, insists=True)


#: What is compiled at the same time, by what has it compiled, each about as long: by the time that
#: `map_pings` gets to free space, it finds on disk what `find_free_space` has compiled.
SESSION: dict[str, Callable[[], None]] = {
    reconstruct_all_kinds.__name__: reconstruct_all_kinds,
    find_free_space.__name__: find_free_space,
    map_pings.__name__: map_pings,
    reconstruct_complex_pulse.__name__: reconstruct_complex_pulse,
}
#: The same with what is rarely needed.
ALL = {
    **SESSION,
    plan_views.__name__: plan_views,
    refine_odometry.__name__: refine_odometry,
}


def _session() -> list[tuple[str, EchoCone]]:
    """What the robots hear, each with who did."""
    from usmap_ros.simulation.points import TRANSDUCER

    cones = []
    for number in range(PINGS):
        for source, (first_rad, turned) in ROBOTS.items():
            round_rad = first_rad + 2.0 * math.pi * number / PINGS
            x_m, y_m = 2.0 + 1.2 * math.cos(round_rad), 1.5 + 0.8 * math.sin(round_rad)
            pose = Pose.planar(x_m, y_m, turned * round_rad)
            cones.append((source, _heard(TRANSDUCER, pose, 10**8 * number)))
    return cones


def _heard(transducer: Transducer, pose: Pose, stamp_ns: int) -> EchoCone:
    """What is heard of the walls and the pole from a pose."""
    x_m, y_m, _ = pose.position_m.tolist()
    echoes = []
    for normal_rad, distance_m in WALLS:
        across_m = distance_m - x_m * math.cos(normal_rad) - y_m * math.sin(normal_rad)
        # As from an image behind the wall.
        echoes.append((across_m, _gain(transducer, pose, normal_rad) / (2.0 * across_m)))
    to_pole = POLE_M[0] - x_m, POLE_M[1] - y_m
    range_m = math.hypot(*to_pole)
    direction_rad = math.atan2(to_pole[1], to_pole[0])
    echoes.append((range_m, _gain(transducer, pose, direction_rad) / range_m**2))
    columns = np.array(sorted(echo for echo in echoes if echo[1] > 0.0), np.float32)
    ranges_m, amplitudes = np.ascontiguousarray(columns.reshape(-1, 2).T)
    return EchoCone(
        stamp_ns=stamp_ns,
        frame_id="map",
        child_frame_id="sonar",
        pose=pose,
        transducer=transducer,
        attenuation_db_m=0.0,
        ranges_m=ranges_m,
        range_stds_m=np.full_like(ranges_m, 1e-4),
        amplitudes=amplitudes,
        amplitude_stds=np.float32(0.02) * amplitudes,
        limit_step_m=0.02,
        detection_limits=encode_limits(np.full(240, 0.02)),
        residual=0.1,
    )


def _gain(transducer: Transducer, pose: Pose, direction_rad: float) -> float:
    """Gain of the beam in a direction; 0 outside."""
    off_rad, beam = abs(wrapped(np.array(direction_rad - pose.yaw_rad))), transducer.beam
    return float(beam.gain(off_rad)) if off_rad < beam.half_angle_rad else 0.0
