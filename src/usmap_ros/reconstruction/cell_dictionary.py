"""The sensing matrix of the paper: a column for each grid cell in the cone.

Sanchez & Andersson, "Using compressive sensing with in-air ultrasonic measurements for robotic
mapping", DSCC 2018-9140, sections 2 to 4.  The column of a cell is the echo of an ideal object
at its centre; Ψ is the identity, because the scene itself is sparse, so that the A = Φ Ψ of
equation (1) is Φ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import sparse

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.arrays import FloatArray, IndexArray, Signal
from usmap_ros.geometry import Pose, at_height
from usmap_ros.reconstruction.baseband import RAYLEIGH_MEAN
from usmap_ros.reconstruction.matrix_operator import MatrixOperator, SparseMatrix
from usmap_ros.trace import EchoTrace, Emission, Encoding


@dataclass(frozen=True)
class ConeCells:
    """Cells of a grid whose centres lie in a sensing cone, by ascending range.

    Parameters
    ----------
    resolution_m : float
        Side of a cell; cell (row, column) covers y from ``row * resolution_m`` and x from
        ``column * resolution_m`` in the world frame.
    rows, columns : (cells,) integer arrays
        Which cells they are.
    ranges_m, bearings_rad : (cells,) arrays
        Of their centres, from the transducer and off its axis.
    gains : (cells,) arrays
        Of the beam.
    """

    resolution_m: float
    rows: IndexArray
    columns: IndexArray
    ranges_m: FloatArray
    bearings_rad: FloatArray
    gains: FloatArray

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def places(self) -> IndexArray:
        """Row and column of every cell, shape (cells, 2)."""
        return np.stack([self.rows, self.columns], axis=-1)

    @property
    def centers_m(self) -> FloatArray:
        """Centres in the world frame, shape (cells, 2)."""
        places = np.stack([self.columns, self.rows], axis=-1).astype(float)
        return (places + 0.5) * self.resolution_m

    @classmethod
    def seen(
        cls, pose: Pose, transducer: Transducer, resolution_m: float, rise_m: float = 0.0
    ) -> ConeCells:
        """Cells within the range limits of a transducer that its beam reaches.

        Parameters
        ----------
        pose : Pose
            Of the transducer, tilted or not.
        transducer : Transducer
            Its beam and range limits.
        resolution_m : float
            Side of a cell.
        rise_m : float
            Height of the objects in the cells above the transducer.
        """
        x_m, y_m = pose.position_m[:2]
        reach = transducer.max_range_m / resolution_m + 1.0
        first_column, first_row = np.floor(np.array([x_m, y_m]) / resolution_m - reach).astype(int)
        side = np.arange(2 * int(np.ceil(reach)) + 2)
        row, column = (grid.reshape(-1) for grid in np.meshgrid(side, side, indexing="ij"))
        row, column = row + first_row, column + first_column
        centers_m = (np.stack([column, row], axis=-1) + 0.5) * resolution_m
        range_m, bearing = pose.polar(at_height(centers_m, pose.position_m[2] + rise_m))
        gain = transducer.beam.gain(bearing)
        seen = (range_m >= transducer.min_range_m) & (range_m <= transducer.max_range_m)
        inside = np.flatnonzero(seen & (gain > 0.0) & (range_m > 0.0))
        order = inside[np.lexsort((bearing[inside], range_m[inside]))]
        return cls(
            resolution_m, row[order], column[order], range_m[order], bearing[order], gain[order]
        )


@dataclass(frozen=True)
class CellSound:
    """A pulse that was in the air, and what cells have to do with it.

    Parameters
    ----------
    pulse : Pulse
        What was emitted.
    ranges_m : (cells,) array
        From the transducer that sent it.
    gains : (cells,) array
        Of its beam on the way there, and of the listening transducer's on the way back.
    mixed_by_hz : float
        What I/Q was mixed down by: the carrier of the transducer that listened.
    """

    pulse: Pulse
    ranges_m: FloatArray
    gains: FloatArray
    mixed_by_hz: float

    @classmethod
    def own(cls, pulse: Pulse, cells: ConeCells) -> CellSound:
        """The pulse of the transducer that listens itself."""
        return cls(pulse, cells.ranges_m, cells.gains, pulse.carrier_hz)


class CellDictionary(MatrixOperator):
    """Φ of Sanchez & Andersson: a column per cell, the cells sorted by distance.

    Parameters
    ----------
    cells : ConeCells
        The cells.
    sounds : sequence of CellSound
        What was emitted, where and how loud the cells heard it: a column is the sum of the echoes
        of all pulses that were in the air.
    channel : Channel
        With a floor, a column is the coherent sum of all paths over it; without, the direct
        path alone (the paper's simple Φ).
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
        as_sparse: bool = False,
    ) -> None:
        self.cells = cells
        matrix = sum(_echoes(cells, sound, channel, sampling, encoding) for sound in sounds)
        super().__init__(matrix if as_sparse else matrix.toarray())
        #: Amplitude of the direct path of an ideal object in each cell.
        self.unit_amplitudes: FloatArray = cells.gains * channel.amplitudes(cells.ranges_m)[:, 0]

    @classmethod
    def for_trace(
        cls,
        trace: EchoTrace,
        resolution_m: float,
        *,
        floor: bool = True,
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
        as_sparse : bool
            Store only the samples that an echo touches.
        """
        channel = trace.channel if floor else replace(trace.channel, floor_height_m=0.0)
        cells = ConeCells.seen(trace.pose, trace.transducer, resolution_m, channel.object_rise_m)
        return cls(
            cells,
            [_sound(trace, emission, cells) for emission in trace.sent],
            channel,
            trace.sampling,
            trace.encoding,
            as_sparse=as_sparse,
        )


def _sound(trace: EchoTrace, emission: Emission, cells: ConeCells) -> CellSound:
    """What the cells of a trace hear and return of a pulse in the air."""
    own_hz = trace.transducer.pulse.carrier_hz
    pulse = emission.transducer.pulse
    if trace.is_own(emission):
        return CellSound.own(pulse, cells)
    sender = trace.pose.compose(emission.mount)
    height_m = trace.pose.position_m[2] + trace.channel.object_rise_m
    ranges_m, bearings_rad = sender.polar(at_height(cells.centers_m, height_m))
    # One way the gain is the root of that both ways.
    gains = np.sqrt(cells.gains * emission.transducer.beam.gain(bearings_rad))
    return CellSound(pulse, ranges_m, gains, own_hz)


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
    cells: ConeCells, sound: CellSound, channel: Channel, sampling: Sampling, encoding: Encoding
) -> SparseMatrix:
    """Echo of an ideal object in each cell, as columns of a sparse matrix."""
    pulse = sound.pulse
    delays_s, amplitudes = channel.between(sound.ranges_m, cells.ranges_m)
    amplitudes = sound.gains[:, np.newaxis] * amplitudes
    sample, age_s = sampling.touched(delays_s, pulse.duration_s)
    column = np.broadcast_to(np.arange(len(cells))[:, np.newaxis, np.newaxis], sample.shape)
    heard = sampling.takes(sample)

    shapes: dict[Encoding, Callable[[FloatArray], Signal]] = {
        Encoding.RAW: pulse.waveform,
        Encoding.ENVELOPE: pulse.window,
        Encoding.IQ: partial(pulse.envelope_above, sound.mixed_by_hz),
    }
    values = amplitudes[..., np.newaxis] * shapes[encoding](age_s)
    if encoding is not Encoding.IQ:
        entries = (values[heard], (sample[heard], column[heard]))
        return sparse.csc_array(entries, shape=(sampling.sample_count, len(cells)))
    carrier = np.exp(-2j * np.pi * sound.mixed_by_hz * delays_s)[..., np.newaxis]
    pairs = (values * carrier)[heard].view(float).reshape(-1, 2)
    rows = 2 * sample[heard][:, np.newaxis] + np.arange(2)
    entries = (pairs.reshape(-1), (rows.reshape(-1), np.repeat(column[heard], 2)))
    return sparse.csc_array(entries, shape=(2 * sampling.sample_count, len(cells)))
