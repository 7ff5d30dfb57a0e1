"""The sensing matrix of the paper: a column for each grid cell in the cone.

Sanchez & Andersson, "Using compressive sensing with in-air ultrasonic measurements for robotic
mapping", DSCC 2018-9140, sections 2 to 4.  The column of a cell is the echo of an ideal object
at its centre; Ψ is the identity, because the scene itself is sparse, so that the A = Φ Ψ of
equation (1) is Φ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy import sparse

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.images import Mirrors
from usmap_ros.acoustics.legs import Legs, straight_legs, wall_legs
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.numerics.arrays import FloatArray, Signal
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import EchoTrace, Emission, Encoding
from usmap_ros.reconstruction.baseband import RAYLEIGH_MEAN
from usmap_ros.reconstruction.cone_cells import ConeCells
from usmap_ros.reconstruction.matrix_operator import MatrixOperator, SparseMatrix


@dataclass(frozen=True)
class CellObjects:
    """What an object in a cell is taken for, and what it stands among."""

    #: Of the objects, which are round and answer from the nearest point of their surface; 0: a
    #: point at the centre of the cell.
    diameter_m: float = 0.0
    #: Of an object that fills a cell, as of a point target: a coefficient is the share of it.
    reflectivity: float = 1.0
    #: Walls that are known: sound goes to a cell, and comes back, by way of each of them too, and
    #: straight to none that is behind one.
    mirrors: Mirrors = field(default_factory=Mirrors.none)


#: An ideal point target, and no walls: the columns of the paper.
IDEAL = CellObjects()


@dataclass(frozen=True)
class CellSound:
    """A pulse that was in the air, and what cells have to do with it."""

    #: What was emitted.
    pulse: Pulse
    #: From the transducer that sent it to the cells, and from them to the one that listened.
    there: Legs
    back: Legs
    #: What I/Q was mixed down by: the carrier of the transducer that listened.
    mixed_by_hz: float

    @classmethod
    def of(
        cls,
        trace: EchoTrace,
        emission: Emission,
        cells: ConeCells,
        channel: Channel,
        objects: CellObjects = IDEAL,
    ) -> CellSound:
        """What the cells of a trace hear and return of a pulse in the air."""

        def legs(pose: Pose, beam: BeamPattern) -> Legs:
            points_m, radius_m = cells.points_m, 0.5 * objects.diameter_m
            straight = straight_legs(pose, beam, channel, points_m, radius_m)
            if not len(objects.mirrors):
                return straight
            walls = wall_legs(pose, beam, channel, points_m, objects.mirrors, radius_m)
            hidden = objects.mirrors.hide(pose.position_m[:2], points_m[:, :2], cells.resolution_m)
            return straight.but(hidden).beside(walls)

        listener = trace.transducer
        back = legs(trace.pose, listener.beam)
        there = back
        if not trace.is_own(emission):
            there = legs(trace.pose.compose(emission.mount), emission.transducer.beam)
        return cls(emission.transducer.pulse, there, back, listener.pulse.carrier_hz)


class CellDictionary(MatrixOperator):
    """Φ of Sanchez & Andersson: a column per cell, the cells sorted by distance.

    Parameters
    ----------
    cells : ConeCells
        Cells in the cone, each of which has a column.
    sounds : sequence of CellSound
        What was emitted, where and how loud the cells heard it: a column is the sum of the echoes
        of all pulses that were in the air.
    channel : Channel
        Gives the speed of sound.  The legs say whether a column is the coherent sum of all paths
        over the floor, or the direct path alone (the paper's simple Φ).
    sampling : Sampling
        When the signal was sampled.
    encoding : Encoding
        How it was sampled.
    as_sparse : bool
        Store only the samples that an echo touches.

    Notes
    -----
    Coefficients are reflectivities, which are real, so a complex column is stored as its real
    and imaginary parts: the rows of an I/Q dictionary are interleaved like the samples of an
    I/Q trace.
    """

    def __init__(
        self,
        cells: ConeCells,
        sounds: Sequence[CellSound],
        channel: Channel,
        sampling: Sampling,
        encoding: Encoding,
        *,
        reflectivity: float = 1.0,
        as_sparse: bool = False,
    ) -> None:
        self.cells = cells
        matrix = reflectivity * sum(
            _echoes(sound, channel.sound_speed_m_s, sampling, encoding) for sound in sounds
        )
        super().__init__(matrix if as_sparse else matrix.toarray())
        #: Amplitude of the direct path of an object in each cell whose coefficient is 1.
        self.unit_amplitudes: FloatArray = (
            reflectivity * cells.gains * channel.amplitudes(cells.ranges_m)[:, 0]
        )

    @classmethod
    def for_trace(
        cls,
        trace: EchoTrace,
        resolution_m: float,
        *,
        floor: bool = True,
        objects: CellObjects = IDEAL,
        as_sparse: bool = False,
    ) -> CellDictionary:
        """Dictionary that explains a trace, after what the trace states of itself.

        Parameters
        ----------
        trace : EchoTrace
            Gives pose, transducer, channel and sampling.
        resolution_m : float
            Side of a cell.
        floor : bool
            Whether to model the paths over the floor.
        objects : CellObjects
            Size of the objects, reflectivity of a full cell, and known walls.
        as_sparse : bool
            Store only the samples that an echo touches.
        """
        channel = trace.channel if floor else replace(trace.channel, floor_height_m=0.0)
        cells = ConeCells.seen(trace.pose, trace.transducer, resolution_m, channel.object_rise_m)
        # Ranges are those at which objects answer.
        heard = replace(cells, ranges_m=np.maximum(cells.ranges_m - 0.5 * objects.diameter_m, 1e-3))
        return cls(
            heard,
            [CellSound.of(trace, one, cells, channel, objects) for one in trace.sent],
            channel,
            trace.sampling,
            trace.encoding,
            reflectivity=objects.reflectivity,
            as_sparse=as_sparse,
        )


def cell_signal(trace: EchoTrace) -> tuple[Signal, float]:
    """What a `CellDictionary` explains of a trace, and the standard deviation of its noise.

    An envelope is freed of the mean that its noise has.  The deviation is 0 where the trace
    does not state its noise.
    """
    samples = np.asarray(trace.samples, dtype=float)
    if trace.encoding is Encoding.IQ:
        return samples, trace.noise_std / np.sqrt(2.0)
    if trace.encoding is Encoding.ENVELOPE:
        mean = RAYLEIGH_MEAN * trace.noise_std
        return samples - mean, float(np.sqrt(trace.noise_std**2 - mean**2))
    return samples, trace.noise_std


def _echoes(
    sound: CellSound, sound_speed_m_s: float, sampling: Sampling, encoding: Encoding
) -> SparseMatrix:
    """Echo of an ideal object in each cell, as columns of a sparse matrix."""
    pulse = sound.pulse
    lengths_m, amplitudes = sound.there.paths(sound.back)
    cell_count = len(lengths_m)
    # Few cells have legs by way of a wall: only the paths that there are count.
    cell, path = np.nonzero(amplitudes)
    delays_s, amplitudes = lengths_m[cell, path] / sound_speed_m_s, amplitudes[cell, path]
    sample, age_s = sampling.touched(delays_s, pulse.length_s)
    column = np.broadcast_to(cell[:, np.newaxis], sample.shape)
    heard = sampling.takes(sample)

    shapes: dict[Encoding, Callable[[FloatArray], Signal]] = {
        Encoding.RAW: pulse.waveform,
        Encoding.ENVELOPE: pulse.window,
        Encoding.IQ: partial(pulse.envelope_above, sound.mixed_by_hz),
    }
    values = amplitudes[:, np.newaxis] * shapes[encoding](age_s)
    if encoding is not Encoding.IQ:
        entries = (values[heard], (sample[heard], column[heard]))
        return sparse.csc_array(entries, shape=(sampling.sample_count, cell_count))
    carrier = np.exp(-2j * np.pi * sound.mixed_by_hz * delays_s)[:, np.newaxis]
    pairs = (values * carrier)[heard].view(float).reshape(-1, 2)
    rows = 2 * sample[heard][:, np.newaxis] + np.arange(2)
    entries = (pairs.reshape(-1), (rows.reshape(-1), np.repeat(column[heard], 2)))
    return sparse.csc_array(entries, shape=(2 * sampling.sample_count, cell_count))
