"""All echoes of a recording, in columns."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray
from usmap_ros.numerics.geometry import wrapped
from usmap_ros.parameters import CorrectionParameters, ReconstructionParameters
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.reconstruction.shared_noise import SharedNoise

#: Paths over the floor arrive from beyond the largest range at which objects are looked for.
_FARTHER = 1.5
#: Stretch of path, either way, on which the neighbours of a ping are, and how many are used.
_REACH_M = 0.8
_NEIGHBOURS = 8


@dataclass(frozen=True)
class EchoTable:
    """Pings and their echoes, those over the floor among them, as if each came from an object."""

    #: (pings, 2) array: where each ping was sent from.
    positions_m: FloatArray
    #: (pings,) arrays: direction of the beam, and standard deviation of the position along any
    #: axis.
    yaws_rad: FloatArray
    position_stds_m: FloatArray
    #: (pings,) integer array: which transducer sent it.
    sensors: IndexArray
    transducers: list[Transducer]
    #: (pings + 1,) integer array: echoes of ping i are ``first_echo[i]`` to ``first_echo[i + 1]``.
    first_echo: IndexArray
    #: (echoes,) integer array: ping of each echo.
    pings: IndexArray
    #: (echoes,) arrays: at the sound speed of `stated`, ascending within each ping.
    ranges_m: FloatArray
    range_stds_m: FloatArray
    #: (echoes,) arrays: in units of the samples.
    amplitudes: FloatArray
    amplitude_stds: FloatArray
    #: What the first trace states.
    stated: Channel
    #: Width of the bins of `limits`.
    limit_step_m: float
    #: For each ping, from its transducer's least range on: the amplitude below which an echo could
    #: have gone unreported.
    limits: list[FloatArray]

    def limit(self, ping: int, range_m: float) -> float:
        """Amplitude below which an echo could have gone unreported."""
        limits = self.limits[ping]
        begin_m = self.transducers[ping].min_range_m
        return float(
            limits[np.clip(int((range_m - begin_m) / self.limit_step_m), 0, len(limits) - 1)]
        )

    @property
    def ping_count(self) -> int:
        """Number of pings."""
        return len(self.yaws_rad)

    def echoes_of(self, ping: int) -> slice:
        """Where the echoes of a ping are in the columns of echoes."""
        return slice(int(self.first_echo[ping]), int(self.first_echo[ping + 1]))

    def without(self, left_out: BoolArray) -> EchoTable:
        """The same without some echoes."""
        kept = ~left_out
        counts = np.bincount(self.pings[kept], minlength=self.ping_count)
        columns = ("pings", "ranges_m", "range_stds_m", "amplitudes", "amplitude_stds")
        echoes = {name: getattr(self, name)[kept] for name in columns}
        first_echo = np.concatenate([[0], np.cumsum(counts)]).astype(np.intp)
        return replace(self, first_echo=first_echo, **echoes)

    def read_as(self, slowness: float, offset_m: float) -> EchoTable:
        """The same with the ranges that another sound speed and offset mean."""
        ranges_m = np.maximum(self.ranges_m / slowness - offset_m, 0.0)
        return replace(self, ranges_m=ranges_m)

    def polar(self, ping: int, places_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance of places (..., 2) from a ping, and their bearing off its beam's axis."""
        offset = places_m - self.positions_m[ping]
        bearing = np.arctan2(offset[..., 1], offset[..., 0]) - self.yaws_rad[ping]
        return np.hypot(offset[..., 0], offset[..., 1]), wrapped(bearing)

    def neighbours(self, ping: int) -> IndexArray:
        """Pings of the same transducer from the stretch of path around `ping`, in order."""
        same = np.flatnonzero(self.sensors == self.sensors[ping])
        here = int(np.searchsorted(same, ping))
        steps = np.linalg.norm(np.diff(self.positions_m[same], axis=0), axis=1)
        way = np.concatenate([[0.0], np.cumsum(steps)])
        near = np.flatnonzero(np.abs(way - way[here]) <= _REACH_M)
        before, after = near[near < here], near[near > here]
        around: IndexArray = same[np.concatenate([_spread(before), [here], _spread(after)])]
        return around


def _spread(members: IndexArray) -> IndexArray:
    """Few of many, evenly."""
    if len(members) <= _NEIGHBOURS:
        return members
    return members[np.linspace(0, len(members) - 1, _NEIGHBOURS).astype(np.intp)]


def listen(
    traces: Iterable[EchoTrace], parameters: ReconstructionParameters, nearer_m: float = 0.0
) -> EchoTable | None:
    """Find the echoes of all traces; None if there is no trace.

    Parameters
    ----------
    traces : iterable of EchoTrace
        In the order of their stamps; frames tell transducers apart.
    parameters : ReconstructionParameters
        Of the reconstruction, by delay and without a floor.
    nearer_m : float
        By how much nearer than the transducer's least range echoes are looked for.
    """
    as_recorded = {"dictionary": "delay", "solver": "cosamp", "correction": CorrectionParameters()}
    parameters = parameters.model_copy(update=as_recorded)
    stated: Channel | None = None
    sensors: dict[str, int] = {}
    pings, columns, limits = [], [], []
    noise = SharedNoise(parameters)
    for trace in map(noise.with_noise, traces):
        stated = stated or trace.channel
        deaf = replace(trace.channel, floor_height_m=0.0)
        farthest_m = _FARTHER * trace.transducer.max_range_m
        nearest_m = max(0.0, trace.transducer.min_range_m - nearer_m)
        transducer = replace(trace.transducer, min_range_m=nearest_m, max_range_m=farthest_m)
        cone = reconstruct(replace(trace, channel=deaf, transducer=transducer), parameters).cone
        scale = stated.sound_speed_m_s / trace.channel.sound_speed_m_s
        columns.append(
            np.stack(
                [
                    scale * cone.ranges_m,
                    scale * cone.range_stds_m,
                    cone.amplitudes,
                    cone.amplitude_stds,
                ]
            ).astype(float)
        )
        sensor = sensors.setdefault(trace.child_frame_id, len(sensors))
        pings.append((trace.pose, sensor, replace(trace.transducer, min_range_m=nearest_m)))
        limits.append(cone.limit_amplitudes())
    if stated is None:
        return None
    counts = [column.shape[1] for column in columns]
    ranges_m, range_stds_m, amplitudes, amplitude_stds = np.concatenate(columns, axis=1)
    return EchoTable(
        positions_m=np.array([pose.position_m[:2] for pose, _, _ in pings]),
        yaws_rad=np.array([pose.yaw_rad for pose, _, _ in pings]),
        position_stds_m=np.sqrt(
            [0.5 * np.trace(pose.planar_covariance[:2, :2]) for pose, _, _ in pings]
        ),
        sensors=np.array([sensor for _, sensor, _ in pings], dtype=np.intp),
        transducers=[transducer for _, _, transducer in pings],
        first_echo=np.concatenate([[0], np.cumsum(counts)]).astype(np.intp),
        pings=np.repeat(np.arange(len(pings)), counts),
        ranges_m=ranges_m,
        range_stds_m=range_stds_m,
        amplitudes=amplitudes,
        amplitude_stds=amplitude_stds,
        stated=stated,
        limit_step_m=parameters.limit_step_m,
        limits=limits,
    )
