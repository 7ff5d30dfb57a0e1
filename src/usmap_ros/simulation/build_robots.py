"""From the robots section of a scenario to robots that move and ping."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from usmap_ros.bounds import MAX_SAMPLES
from usmap_ros.errors import UsmapError
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import Encoding
from usmap_ros.simulation.models.conditions import MediumModel, StatedModel
from usmap_ros.simulation.models.robots import PoseErrorModel, RobotModel
from usmap_ros.simulation.models.transducers import TransducerModel
from usmap_ros.simulation.motion import (
    Bounds,
    CarriedOff,
    DelayedMotion,
    Motion,
    RandomWalk,
    WaypointModel,
    WaypointMotion,
)
from usmap_ros.simulation.robot import SimulatedRobot
from usmap_ros.simulation.scene import Scene
from usmap_ros.simulation.simulator import MountedTransducer


def build_robot(
    model: RobotModel,
    *,
    scene: Scene,
    area: Bounds,
    medium: MediumModel,
    stated: StatedModel,
    first_ping_s: float,
    motion_seed: np.random.SeedSequence,
    noise_seed: np.random.SeedSequence,
) -> SimulatedRobot:
    """A robot of a scenario.

    Parameters
    ----------
    model : RobotModel
        The robot's section.
    scene : Scene
        What it must not run into.
    area : (x_min, x_max, y_min, y_max)
        Where it may wander.
    medium, stated : MediumModel, StatedModel
        What the sound goes through, and what the messages say of it.
    first_ping_s : float
        When its first transducer pings first; the others share the rest of the interval evenly,
        since transducers of one robot would hear one another, unless they are to.
    motion_seed, noise_seed : numpy.random.SeedSequence
        For its path, and for the noise and pose errors of its transducers.

    Raises
    ------
    UsmapError
        Naming the key, if its path is blocked, or a transducer cannot exist.
    """
    count = len(model.transducers)
    interval_s = 1.0 / model.ping_rate_hz
    turns = [0] * count if model.simultaneous else range(count)
    seeds = noise_seed.spawn(count + 1)
    with _errors_name("motion: "):
        motion = _motion(model, scene, area, motion_seed)
    transducers = []
    for number, transducer in enumerate(model.transducers):
        with _errors_name(f"transducers.{number}."):
            transducers.append(_mounted(model, transducer, medium, stated))
    return SimulatedRobot(
        name=model.name,
        motion=motion,
        transducers=transducers,
        first_ping_s=[first_ping_s + turn * interval_s / count for turn in turns],
        ping_interval_s=interval_s,
        noise_seeds=seeds[:-1],
        simultaneous=model.simultaneous,
        moves_during_ping=model.moves_during_ping,
        error_seed=seeds[-1],
        pose_wander_s=model.pose_error.wander_s,
        pose_late_s=model.pose_error.late_s,
        odometry=model.odometry,
        jumps_s=tuple(move.at_s for move in model.carried_off),
    )


@contextmanager
def _errors_name(key: str) -> Iterator[None]:
    """Put a key of the scenario before what errors say, which may begin with one of its own."""
    try:
        yield
    except UsmapError as error:
        raise UsmapError(f"{key}{error}") from error


def check_is_within(model: RobotModel, area: Bounds) -> None:
    """Refuse a robot that is to be outside of its world.

    Raises
    ------
    UsmapError
        Naming the key and the first place that is.
    """
    motion = model.motion
    if isinstance(motion, WaypointModel):
        key, places = "waypoints_m", list(motion.waypoints_m)
    else:
        key, places = "start", [] if motion.start is None else [motion.start[:2]]
    x_min, x_max, y_min, y_max = area
    for x_m, y_m in places:
        if not (x_min <= x_m <= x_max and y_min <= y_m <= y_max):
            raise UsmapError(
                f"motion.{key}: ({x_m:g}, {y_m:g}) is outside of the world, which is"
                f" x {x_min:g} to {x_max:g} m and y {y_min:g} to {y_max:g} m"
            )


def _motion(model: RobotModel, scene: Scene, area: Bounds, seed: np.random.SeedSequence) -> Motion:
    """How a robot moves, standing at first or carried off in between where it is to."""
    first = DelayedMotion(_own_motion(model, scene, area, seed), model.starts_after_s)
    motion = model.motion
    if not model.carried_off or isinstance(motion, WaypointModel):
        return first
    seeds = seed.spawn(len(model.carried_off))
    then: list[tuple[float, Motion]] = []
    for move, own in zip(model.carried_off, seeds, strict=True):
        there = Pose.planar(*move.to)
        then.append((move.at_s, RandomWalk(motion, scene, area, there, np.random.default_rng(own))))
    return CarriedOff(first, then)


def _own_motion(
    model: RobotModel, scene: Scene, area: Bounds, seed: np.random.SeedSequence
) -> Motion:
    motion = model.motion
    if isinstance(motion, WaypointModel):
        return WaypointMotion(motion, scene)
    start = None if motion.start is None else Pose.planar(*motion.start)
    return RandomWalk(motion, scene, area, start, np.random.default_rng(seed))


def _mounted(
    robot: RobotModel, model: TransducerModel, medium: MediumModel, stated: StatedModel
) -> MountedTransducer:
    transducer, receiver = model.build(), model.receiver.build()
    channel = medium.channel(transducer.pulse.carrier_hz, model.mount.z_m)
    # With several transducers each has a namespace of its own below the robot's.
    parts = [robot.name, "echo"]
    if len(robot.transducers) > 1:
        parts.insert(1, model.name)
    mounted = MountedTransducer(
        topic="/" + "/".join(parts),
        child_frame_id=f"{robot.name}/{model.name}",
        mount=model.mount.build(),
        transducer=transducer,
        receiver=receiver,
        channel=channel,
        stated_channel=stated.channel(channel),
        stated_noise_std=(
            receiver.stated_noise_std if stated.noise_std is None else stated.noise_std
        ),
        pose_stds=_pose_stds(robot.pose_error),
        emits=model.emits,
        receiver_offset_m=np.array(model.receiver_offset_m),
        drift_m_s2=medium.drift_m_s2,
    )
    _check_sampling(mounted)
    return mounted


def _check_sampling(mounted: MountedTransducer) -> None:
    """Raise `UsmapError` where no reader would believe the traces."""
    receiver, pulse = mounted.receiver, mounted.transducer.pulse
    count = receiver.sample_count(mounted.listening_s)
    if not 1 < count <= MAX_SAMPLES:
        raise UsmapError(
            f"receiver: takes {count} samples between {receiver.start_delay_s:g} s and"
            f" {mounted.listening_s:g} s, must be 2 to {MAX_SAMPLES}"
        )
    if receiver.encoding is Encoding.RAW and receiver.sample_rate_hz < 2.0 * pulse.carrier_hz:
        raise UsmapError(
            f"receiver.sample_rate_hz: raw samples at {receiver.sample_rate_hz:g} Hz cannot hold a"
            f" carrier of {pulse.carrier_hz:g} Hz, which needs more than twice as many; take iq"
        )
    if receiver.sample_rate_hz * pulse.duration_s < 1.0:
        raise UsmapError(
            f"receiver.sample_rate_hz: {receiver.sample_rate_hz:g} Hz is less than one sample in"
            f" a pulse of {pulse.duration_s:g} s"
        )


def _pose_stds(error: PoseErrorModel) -> FloatArray:
    return np.array([error.position_std_m, error.position_std_m, error.yaw_std_rad])
