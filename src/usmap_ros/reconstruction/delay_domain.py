"""The sensing matrix on the delay axis, applied without being formed.

All cells at one range have columns that are multiples of one another, so echoes are
recovered as functions of delay, where atoms are distinct.  Φᴴ r is then a matched filter.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import cached_property

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal
from usmap_ros.numerics.special import running_maximum
from usmap_ros.reconstruction.sampled.matrix import (
    POINTS,
    POINTS_PER_CYCLE,
    POINTS_PER_POINT,
    SampledMatrix,
)
from usmap_ros.reconstruction.template import Template


class DelayDomainOperator:
    """Echoes at every delay of an even grid, each with its paths over the floor as one block.

    Parameters
    ----------
    template : Template
        Envelope of one echo.
    sampling : Sampling
        When the signal was sampled.
    channel : Channel
        Gives the delays of the paths.
    min_range_m, max_range_m : float
        Ranges on which blocks are laid.
    oversampling : int
        Delays per sample.
    exclusion_s : float
        Half-width of the band of delays around a chosen block in which no other is chosen.

    Notes
    -----
    Every path of a block has a coefficient of its own: a centimetre of error in the floor's
    height turns a phase by several radians, so only the magnitudes can be relied on.  They
    enter in `scores`.
    """

    def __init__(
        self,
        template: Template,
        sampling: Sampling,
        channel: Channel,
        min_range_m: float,
        max_range_m: float,
        oversampling: int,
        exclusion_s: float,
    ) -> None:
        self.template, self.sampling, self.channel = template, sampling, channel
        self.oversampling = oversampling
        self.delay_step_s = 1.0 / (sampling.sample_rate_hz * oversampling)
        self._band = max(1, round(exclusion_s / self.delay_step_s))
        self._polyphase = self._sampled_template()
        self.range_step_m = 0.5 * channel.sound_speed_m_s * self.delay_step_s
        self.ranges_m = self._block_ranges(min_range_m, max_range_m)
        self._path_index = self._grid_index(channel.delays_s(self.ranges_m))
        self._norms = np.linalg.norm(self._polyphase, axis=1)[self._path_index % oversampling]
        echo = channel.amplitudes(self.ranges_m) * self._norms
        #: Share of a block's echo that each path carries.
        self.path_weights = echo / np.linalg.norm(echo, axis=1, keepdims=True)
        #: Norm of the echo of an object whose direct path has amplitude 1, shape (blocks,).
        self.unit_norms = self._norms[:, 0] / self.path_weights[:, 0]
        # Where the blocks are: on the grid, where every path is rounded to it, until moved.
        self._block_ranges_m = self.ranges_m
        self._grid_delays_s = (
            self._grid_start_s + self._path_index.astype(np.float64) * self.delay_step_s
        )
        self._block_delays_s = self._grid_delays_s
        self._moved: IndexArray = np.empty(0, dtype=np.intp)
        self._last_columns: tuple[IndexArray, Signal] = self._no_columns()

    def blocks(self, part: int) -> slice:
        """All blocks: there is one pulse, of number 0."""
        return slice(0, self.block_count)

    # ------------------------------------------------------------------ SensingOperator

    @property
    def sample_count(self) -> int:
        """Samples of the signal."""
        return self.sampling.sample_count

    @property
    def block_count(self) -> int:
        """Delays at which an object can be placed."""
        return len(self.ranges_m)

    @property
    def block_size(self) -> int:
        """Paths from an object: one, or three with a floor."""
        return int(self._path_index.shape[1])

    def forward(self, coefficients: Signal) -> Signal:
        """Sum of the echoes: every path's template at its delay, times its coefficient."""
        moved = self._moved
        on_grid = coefficients.copy()
        on_grid[moved] = 0.0
        spikes = np.zeros(self._window_count * self.oversampling, dtype=coefficients.dtype)
        np.add.at(spikes, self._path_index, on_grid)
        trains = spikes.reshape(self._window_count, self.oversampling) @ self._polyphase
        taps = trains.shape[1]
        signal = np.zeros(self._window_count + taps - 1, dtype=trains.dtype)
        for tap in range(taps):
            signal[tap : tap + self._window_count] += trains[:, tap]
        heard: Signal = signal[taps - 1 : taps - 1 + self.sample_count]
        heard = heard + self.columns(moved) @ coefficients[moved].reshape(-1)
        return heard

    def adjoint(self, signal: Signal) -> Signal:
        """Matched filter, read at the delays of all paths."""
        taps = self._polyphase.shape[1]
        padded = np.zeros(self._window_count + taps - 1, dtype=signal.dtype)
        padded[taps - 1 : taps - 1 + self.sample_count] = signal
        # A view in which row i is the signal from sample i on; NumPy's own sliding_window_view
        # takes longer to make than the product that it is for.
        windows: Signal = np.ndarray(
            (self._window_count, taps), signal.dtype, padded, strides=2 * padded.strides
        )
        filtered = windows @ self._polyphase.conj().T
        proxy: Signal = filtered.reshape(-1)[self._path_index]
        if len(self._moved):
            at_moved = self.columns(self._moved).conj().T @ signal
            proxy[self._moved] = at_moved.reshape(-1, self.block_size)
        return proxy

    def columns(self, support: IndexArray) -> Signal:
        """Templates at the delays of the blocks' paths."""
        # Solver, matched filter and refinement ask for the same support in turn.
        known_support, known_columns = self._last_columns
        if np.array_equal(support, known_support):
            return known_columns
        columns = self._scatter(self.delays_s(support).reshape(-1), self.template)
        self._last_columns = (support.copy(), columns)
        return columns

    def scores(self, proxy: Signal) -> FloatArray:
        """Magnitudes of the paths, weighted by what each should carry of the block's echo."""
        scores: FloatArray = np.sum(self.path_weights * np.abs(proxy) / self._norms, axis=1)
        return scores

    def echo_scores(self, support: IndexArray, coefficients: Signal) -> FloatArray:
        """Scores that the echoes of `support` have by themselves."""
        weighted = self.path_weights[support] * np.abs(coefficients) * self._norms[support]
        scores: FloatArray = weighted.sum(axis=1)
        return scores

    def excluded(self, block: int) -> slice:
        """Band of delays in which two echoes cannot be told apart."""
        return slice(max(0, block - self._band), block + self._band + 1)

    def bands(self, support: IndexArray) -> tuple[IndexArray, IndexArray]:
        """Where the bands about blocks begin, and where they end."""
        return np.maximum(support - self._band, 0), support + self._band + 1

    def rivals(self, block: int) -> slice | IndexArray:
        """Blocks of which any path falls into the band of any path of `block`."""
        if self.block_size == 1:
            return self.excluded(block)
        distance = np.abs(self._path_index[:, :, np.newaxis] - self._path_index[block])
        return np.flatnonzero((distance <= self._band).any(axis=(1, 2)))

    @cached_property
    def sampled(self) -> SampledMatrix:
        """The matrix as compiled code takes it, with all blocks on the grid."""
        rate_hz = self.sampling.sample_rate_hz
        time_s = self.template.grid_s(POINTS, POINTS_PER_CYCLE, POINTS_PER_POINT)
        values = self.template(time_s)
        windows, phases = np.divmod(self._path_index, self.oversampling)
        return SampledMatrix(
            polyphase=np.ascontiguousarray(self._polyphase),
            delays_s=self._grid_delays_s,
            places=phases * self._window_count + windows,
            weights=np.array([self.path_weights / self._norms, self.path_weights * self._norms]),
            pulse=np.array([values, self.template.slope(time_s).astype(values.dtype, copy=False)]),
            duration_s=self.template.duration_s,
            sample_rate_hz=rate_hz,
            start_delay_s=self.sampling.start_delay_s,
            sample_count=self.sample_count,
            grid_start_s=self._grid_start_s,
            delay_step_s=self.delay_step_s,
            band=self._band,
            sound_speed_m_s=self.channel.sound_speed_m_s,
            floor_detour_m2=self.channel.floor_detour_m2,
            floor_legs=self.channel.floor_legs,
        )

    # ------------------------------------------------------------------ off the grid

    def moved(self, support: IndexArray, steps_s: FloatArray) -> DelayDomainOperator:
        """Return an operator in which the direct paths of `support` are later by `steps_s`."""
        refined = copy.copy(self)
        ranges_m = self.block_ranges_m(support) + 0.5 * self.channel.sound_speed_m_s * steps_s
        refined._block_ranges_m = self._block_ranges_m.copy()
        refined._block_ranges_m[support] = ranges_m
        refined._block_delays_s = self._block_delays_s.copy()
        refined._block_delays_s[support] = self.channel.delays_s(ranges_m)
        refined._moved = np.union1d(self._moved, support)
        refined._last_columns = self._no_columns()
        return refined

    def block_ranges_m(self, support: IndexArray) -> FloatArray:
        """Ranges of blocks, off the grid where they were moved."""
        return self._block_ranges_m[support]

    def delays_s(self, support: IndexArray) -> FloatArray:
        """Delays of the blocks' paths, shape (len(support), block_size).

        On the grid every path is rounded to it, off the grid they are exact.
        """
        return self._block_delays_s[support]

    def slopes(self, support: IndexArray) -> Signal:
        """Derivatives of `columns` with respect to the delay of each block's direct path."""
        rates = self.channel.delay_rates(self.block_ranges_m(support)).reshape(-1)
        delays_s = self.delays_s(support).reshape(-1)
        slopes: Signal = -rates * self._scatter(delays_s, self.template.slope)
        return slopes

    def _no_columns(self) -> tuple[IndexArray, Signal]:
        return np.empty(0, dtype=np.intp), np.zeros((self.sample_count, 0))

    def _scatter(self, delays_s: FloatArray, profile: Callable[[FloatArray], Signal]) -> Signal:
        """Profiles at delays as columns; each touches only the samples in its support."""
        samples, ages_s = self.sampling.touched(delays_s, self.template.duration_s)
        values = profile(ages_s)
        # What lies before or after the signal falls into a margin on either side of it.
        padded = np.zeros((self.sample_count + 2, len(delays_s)), dtype=values.dtype)
        rows = np.clip(samples, -1, self.sample_count) + 1
        padded[rows, np.arange(len(delays_s))[:, np.newaxis]] = values
        columns: Signal = padded[1:-1]
        return columns

    def overlaps(self, support: IndexArray) -> FloatArray:
        """Correlation of the direct echoes of each two blocks, 0 of a block with itself."""
        return self.template.overlaps(self.delays_s(support)[:, 0])

    def loudness(self, scores: FloatArray) -> FloatArray:
        """Loudest score within a pulse of each block."""
        loudest: FloatArray = running_maximum(scores, 2 * self.pulse_blocks + 1)
        return loudest

    @property
    def pulse_blocks(self) -> int:
        """Blocks that a pulse spans."""
        return int(np.ceil(self.template.duration_s / self.delay_step_s))

    @cached_property
    def extra_paths(self) -> FloatArray:
        """Weights of all paths but the first, or what stands in for them, shape (blocks,)."""
        return np.asarray(self.path_weights.sum(axis=1) - 1.0)

    @cached_property
    def template_skewness(self) -> float:
        """Share of a sample's skewness that is left in the matched filter's output.

        Only an envelope's noise is skewed, and its template is real.
        """
        template = self._polyphase[0].real
        return float(np.sum(template**3) / np.sum(template**2) ** 1.5)

    # ------------------------------------------------------------------ the grid

    @property
    def _window_count(self) -> int:
        """Sample positions at which a template can start and still touch the signal."""
        return int(self.sample_count + self._polyphase.shape[1] - 1)

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
        return 0.0 if self.template.is_smooth else 0.5 * self.delay_step_s

    def _sampled_template(self) -> Signal:
        """Template at every sub-sample delay, shape (oversampling, taps)."""
        rate_hz = self.sampling.sample_rate_hz
        taps = int(np.ceil(self.template.duration_s * rate_hz)) + 2
        delay_s = self._grid_offset_s + np.arange(self.oversampling) * self.delay_step_s
        return self.template(np.arange(taps) / rate_hz - delay_s[:, np.newaxis])

    def _block_ranges(self, min_range_m: float, max_range_m: float) -> FloatArray:
        """Ranges on the grid whose direct echo lies within the limits and the trace."""
        speed = self.channel.sound_speed_m_s
        end_s = self.sampling.end_s - self.template.duration_s
        # A point at the transducer itself would return an infinite echo.
        nearest_m = max(min_range_m, self.range_step_m)
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
