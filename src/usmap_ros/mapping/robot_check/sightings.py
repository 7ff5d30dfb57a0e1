"""What a robot heard, and from where, as arrays."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import wrapped
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.range_cones import is_deaf_behind
from usmap_ros.pings.telling_echoes import first_and_loudest, levels_db

#: Angles at which a beam's gain is tabulated, as shares of its half angle; the least gain, dB.
ANGLES, FAINTEST_DB = 33, -30.0
#: Echoes a metre that nothing known explains, for each echo of a ping.
UNEXPLAINED = 0.3


class Sightings(NamedTuple):
    """Pings and their echoes."""

    #: (pings,) arrays: poses of the transducer.
    x_m: FloatArray
    y_m: FloatArray
    yaw_rad: FloatArray
    #: (pings,) array: of its beam.
    half_rad: FloatArray
    #: (pings,) array: of what it hears, dB re amplitude 1.
    limit_db: FloatArray
    #: (pings,) array: how far it hears.
    reach_m: FloatArray
    #: (pings + 1,) int array: of each ping's echoes, and the end.
    first: NDArray[np.int64]
    #: (echoes,) int array: whose they are.
    ping: NDArray[np.int64]
    #: (echoes,) arrays: how far, and how loud but for the absorption of air.
    range_m: FloatArray
    level_db: FloatArray
    #: (ANGLES,) array: of the beam, from its axis to its edge.
    gains_db: FloatArray
    #: Echoes per metre that nothing known explains.
    background: float


def sightings_of(cones: Sequence[EchoCone]) -> Sightings | None:
    """Pings of one robot; None if they hear nothing, or the nearest thing only.

    The latter know no loudness, and the edges of their beams hear what stands askew.
    """
    heard = [cone for cone in cones if len(cone.ranges_m)]
    if not heard or sum(map(is_deaf_behind, heard)) > 0.5 * len(heard):
        return None
    heard_db = [levels_db(cone) for cone in cones]
    kept = [first_and_loudest(cone, own_db) for cone, own_db in zip(cones, heard_db, strict=True)]
    counts = [len(rows) for rows in kept]
    poses = np.array([[*cone.pose.position_m[:2], cone.pose.yaw_rad] for cone in cones], float)
    columns = np.array(
        [
            [
                cone.transducer.beam.half_angle_rad,
                20.0 * np.log10(np.median(cone.limit_amplitudes())),
                cone.transducer.max_range_m,
            ]
            for cone in cones
        ]
    )
    range_m = np.concatenate([c.ranges_m[rows] for c, rows in zip(cones, kept, strict=True)])
    level_db = np.concatenate([own[rows] for own, rows in zip(heard_db, kept, strict=True)])
    beam = heard[0].transducer.beam
    gains = beam.gain(np.linspace(0.0, beam.half_angle_rad, ANGLES))
    x_m, y_m, yaw_rad = np.ascontiguousarray(poses.T)
    half_rad, limit_db, reach_m = np.ascontiguousarray(columns.T)
    return Sightings(
        x_m, y_m, yaw_rad, half_rad, limit_db, reach_m,
        np.append(0, np.cumsum(counts)).astype(np.int64),
        np.repeat(np.arange(len(cones)), counts), range_m.astype(float), level_db,
        20.0 * np.log10(np.maximum(gains, 10.0 ** (FAINTEST_DB / 20.0))),
        UNEXPLAINED * sum(counts) / len(heard),
    )  # fmt: skip


class RobotTrack:
    """When a robot was where, by each of its transducers."""

    def __init__(self, cones: Sequence[EchoCone], heard: Sightings) -> None:
        self._stamps_s = 1e-9 * np.array([c.stamp_ns - cones[0].stamp_ns for c in cones], float)
        frames = [cone.child_frame_id for cone in cones]
        self._rows = [
            np.array([row for row, name in enumerate(frames) if name == one])
            for one in dict.fromkeys(frames)
        ]
        self._heard = heard

    def later(self, by_s: float) -> tuple[Sightings, NDArray[np.bool_]]:
        """The same pings from where the robot was so much later; of which pings that is known."""
        heard, known = self._heard, np.zeros(len(self._stamps_s), np.bool_)
        poses = np.stack([heard.x_m, heard.y_m, heard.yaw_rad])
        for rows in self._rows:
            stamps_s = self._stamps_s[rows]
            at_s = stamps_s + by_s
            known[rows] = (at_s >= stamps_s[0]) & (at_s <= stamps_s[-1])
            told = np.unwrap(poses[:, rows], axis=1)
            told[:2] = poses[:2, rows]
            poses[:, rows] = [np.interp(at_s, stamps_s, row) for row in told]
        x_m, y_m, yaw_rad = np.ascontiguousarray(poses)
        return heard._replace(x_m=x_m, y_m=y_m, yaw_rad=wrapped(yaw_rad)), known
