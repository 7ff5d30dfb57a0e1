"""The sensing matrix on the delay axis, which is never formed.

All cells at one range have columns that are multiples of one another, so echoes are
recovered as functions of delay, where atoms are distinct.  Φᴴ r is then a matched filter.

What a receiver hears of several pulses at once is y = Σₑ Φₑ xₑ over the pulses e that were sent.
Beside each other the Φₑ make one matrix [Φ₁ Φ₂ …], whose blocks say which pulse an echo is of: two
different pulses make "a more unique signature for received signals" (Sanchez & Andersson,
DSCC 2018-9140, section 3).
"""

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal
from usmap_ros.reconstruction.sampled.matrix import (
    POINTS,
    POINTS_PER_CYCLE,
    POINTS_PER_POINT,
    SampledMatrix,
)
from usmap_ros.reconstruction.template import Template

#: Ridge of least squares, but where more is asked for.
RIDGE = 1e-10


class DelayDictionary:
    """Echoes of one or several pulses at every delay of an even grid.

    An object's paths over the floor make one block.  Blocks of the first pulse come before those
    of the second, each with the same ranges.

    Parameters
    ----------
    templates : sequence of Template
        Envelope of one echo of each pulse.
    sampling : Sampling
        When the signal was sampled.
    channel : Channel
        Gives the delays of the paths.
    min_range_m, max_range_m : float
        Ranges on which blocks are laid.
    oversampling : int
        Delays per sample.
    exclusions_s : sequence of float
        Half-width, for each pulse, of the band of delays around a chosen block in which no other
        of that pulse is chosen.

    Notes
    -----
    Every path of a block has a coefficient of its own: a centimetre of error in the floor's
    height turns a phase by several radians, so only the magnitudes can be relied on.  They
    enter in the scores.
    """

    def __init__(
        self,
        templates: Sequence[Template],
        sampling: Sampling,
        channel: Channel,
        min_range_m: float,
        max_range_m: float,
        oversampling: int,
        exclusions_s: Sequence[float],
    ) -> None:
        self.templates, self.sampling, self.channel = tuple(templates), sampling, channel
        self.oversampling = oversampling
        self.delay_step_s = 1.0 / (sampling.sample_rate_hz * oversampling)
        self._bands = np.array([max(1, round(one / self.delay_step_s)) for one in exclusions_s])
        self._longest_s = max(template.duration_s for template in templates)
        self._polyphase = self._sampled_templates()
        #: Ranges at which each pulse has a block, (ranges,).
        self.ranges_m = self._block_ranges(min_range_m, max_range_m)
        self._path_index = self._grid_index(channel.delays_s(self.ranges_m))
        first_rows = oversampling * np.arange(len(templates))[:, np.newaxis, np.newaxis]
        #: Row of the matched filter's output that each path of each block is in.
        self._rows = first_rows + self._path_index % oversampling
        norms = np.linalg.norm(self._polyphase, axis=1)[self._rows]
        echo = channel.amplitudes(self.ranges_m) * norms
        paths = echo.shape[-1]
        self._norms = norms.reshape(-1, paths)
        #: Share of a block's echo that each path carries, (blocks, paths).
        self.path_weights = (echo / np.linalg.norm(echo, axis=-1, keepdims=True)).reshape(-1, paths)
        #: Norm of the echo of an object whose direct path has amplitude 1, (blocks,).
        self.unit_norms = self._norms[:, 0] / self.path_weights[:, 0]

    @property
    def block_count(self) -> int:
        """Delays at which an object can be placed, of all pulses."""
        return len(self.unit_norms)

    @property
    def is_smooth(self) -> bool:
        """Whether delays of all pulses can be told finer than a sample."""
        return all(template.is_smooth for template in self.templates)

    def pulse_numbers(self, support: IndexArray) -> IndexArray:
        """Which pulse blocks are echoes of."""
        return support // max(len(self.ranges_m), 1)

    def of_pulses(self, support: IndexArray, values: Sequence[float]) -> FloatArray:
        """Of one value for each pulse, that of every echo's."""
        return np.asarray(values, dtype=float)[self.pulse_numbers(support)]

    def bands(self, support: IndexArray) -> tuple[IndexArray, IndexArray]:
        """Where the bands about blocks begin, and where they end: with their pulse's blocks."""
        pulses = self.pulse_numbers(support)
        band, first = self._bands[pulses], pulses * len(self.ranges_m)
        begins = np.maximum(support - band, first)
        return begins, np.minimum(support + band + 1, first + len(self.ranges_m))

    @cached_property
    def extra_paths(self) -> FloatArray:
        """Weights of all paths but the first, or what stands in for them, shape (blocks,)."""
        return np.asarray(self.path_weights.sum(axis=1) - 1.0)

    @cached_property
    def template_skewness(self) -> FloatArray:
        """Share of a sample's skewness that is left in the matched filter's output, (blocks,).

        Only an envelope's noise is skewed, and its template is real.
        """
        real = self._polyphase[:: self.oversampling].real
        left = np.sum(real**3, axis=1) / np.sum(real**2, axis=1) ** 1.5
        return np.repeat(left, len(self.ranges_m))

    @cached_property
    def sampled(self) -> SampledMatrix:
        """The matrix as compiled code takes it, with all blocks on the grid."""
        points = max(
            one.point_count(POINTS, POINTS_PER_CYCLE, POINTS_PER_POINT) for one in self.templates
        )
        times_s = [
            np.linspace(one.start_s, one.start_s + one.duration_s, points) for one in self.templates
        ]
        pulses = [
            [one(time_s), one.slope(time_s)]
            for one, time_s in zip(self.templates, times_s, strict=True)
        ]
        windows = self._path_index // self.oversampling
        return SampledMatrix(
            polyphase=np.ascontiguousarray(self._polyphase),
            delays_s=self._grid_start_s + self._path_index.astype(np.float64) * self.delay_step_s,
            places=(self._rows * self._window_count + windows).reshape(self._norms.shape),
            weights=np.array([self.path_weights / self._norms, self.path_weights * self._norms]),
            pulses=np.array(pulses).astype(self._polyphase.dtype, copy=False),
            durations_s=np.array([template.duration_s for template in self.templates]),
            sample_rate_hz=self.sampling.sample_rate_hz,
            start_delay_s=self.sampling.start_delay_s,
            sample_count=self.sampling.sample_count,
            grid_start_s=self._grid_start_s,
            delay_step_s=self.delay_step_s,
            bands=self._bands,
            sound_speed_m_s=self.channel.sound_speed_m_s,
            floor_detour_m2=self.channel.floor_detour_m2,
            floor_legs=self.channel.floor_legs,
            ridge=RIDGE,
        )

    # ------------------------------------------------------------------ the grid

    @property
    def _window_count(self) -> int:
        """Sample positions at which a template can start and still touch the signal."""
        return int(self.sampling.sample_count + self._polyphase.shape[1] - 1)

    @property
    def _grid_start_s(self) -> float:
        """Delay of the first grid point, from which on a template reaches the first sample."""
        taps_before = self._polyphase.shape[1] - 1
        start_s = self.sampling.start_delay_s - taps_before / self.sampling.sample_rate_hz
        return float(start_s + self._grid_offset_s)

    @property
    def _grid_offset_s(self) -> float:
        """Delay of the grid behind the samples.

        The edge of a pulse never falls on a sample exactly, so that the grid avoids the samples
        where edges are sharp: there it would take one sample too many for a part of the pulse.
        """
        return 0.0 if self.is_smooth else 0.5 * self.delay_step_s

    def _sampled_templates(self) -> Signal:
        """Templates at every sub-sample delay, shape (pulses * oversampling, taps)."""
        rate_hz = self.sampling.sample_rate_hz
        taps = math.ceil(self._longest_s * rate_hz) + 2
        delay_s = self._grid_offset_s + np.arange(self.oversampling) * self.delay_step_s
        ages_s = np.arange(taps) / rate_hz - delay_s[:, np.newaxis]
        return np.concatenate([template(ages_s) for template in self.templates])

    def _block_ranges(self, min_range_m: float, max_range_m: float) -> FloatArray:
        """Ranges on the grid whose direct echo lies within the limits and the trace."""
        speed = self.channel.sound_speed_m_s
        end_s = self.sampling.end_s - self._longest_s
        # A point at the transducer itself would return an infinite echo.
        nearest_m = max(min_range_m, 0.5 * speed * self.delay_step_s)
        first_delay_s = max(2.0 * nearest_m / speed, self.sampling.start_delay_s)
        first = np.ceil((first_delay_s - self._grid_start_s) / self.delay_step_s - 1e-6)
        last_delay_s = min(2.0 * max_range_m / speed, end_s)
        last = np.floor((last_delay_s - self._grid_start_s) / self.delay_step_s + 1e-6)
        delays_s = self._grid_start_s + np.arange(first, last + 1.0) * self.delay_step_s
        return 0.5 * speed * delays_s

    def _grid_index(self, delays_s: FloatArray) -> IndexArray:
        """Nearest grid point to each delay; past the end of the trace, the last one."""
        index = np.rint((delays_s - self._grid_start_s) / self.delay_step_s).astype(np.intp)
        clipped: IndexArray = np.minimum(index, self._window_count * self.oversampling - 1)
        return clipped
