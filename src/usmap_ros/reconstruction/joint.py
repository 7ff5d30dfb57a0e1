"""Several pulses in the air at once: one sensing matrix that holds the echoes of each.

What a receiver hears is y = Σₑ Φₑ xₑ over the pulses e that were sent.  Beside each other the Φₑ
make one matrix [Φ₁ Φ₂ …], whose blocks say which pulse an echo is of: two different pulses make "a
more unique signature for received signals" (Sanchez & Andersson, DSCC 2018-9140, section 3).
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal
from usmap_ros.reconstruction.delay_domain import DelayDomainOperator


class JointOperator:
    """Sensing matrices of several pulses side by side; the blocks of each follow one another.

    Parameters
    ----------
    parts : sequence of DelayDomainOperator
        One for each pulse, of one sampling, channel and oversampling.
    """

    def __init__(self, parts: Sequence[DelayDomainOperator]) -> None:
        self.parts = tuple(parts)
        counts = [part.block_count for part in parts]
        self._ends = np.cumsum(counts)
        self._starts = self._ends - counts
        self.oversampling, self.delay_step_s = parts[0].oversampling, parts[0].delay_step_s
        self.channel = parts[0].channel
        self.ranges_m = np.concatenate([part.ranges_m for part in parts])
        self.unit_norms = np.concatenate([part.unit_norms for part in parts])
        self.path_weights = np.concatenate([part.path_weights for part in parts])
        self.extra_paths = np.concatenate([part.extra_paths for part in parts])
        self.template_skewness = np.repeat([part.template_skewness for part in parts], counts)

    def blocks(self, part: int) -> slice:
        """Blocks of the pulse of that number."""
        return slice(int(self._starts[part]), int(self._ends[part]))

    # ------------------------------------------------------------------ SensingOperator

    @property
    def sample_count(self) -> int:
        """Samples of the signal."""
        return self.parts[0].sample_count

    @property
    def block_count(self) -> int:
        """Delays of all pulses."""
        return int(self._ends[-1])

    @property
    def block_size(self) -> int:
        """Paths from an object."""
        return self.parts[0].block_size

    def forward(self, coefficients: Signal) -> Signal:
        """Σₑ Φₑ xₑ."""
        signal: Signal = np.sum(
            [
                part.forward(coefficients[self.blocks(number)])
                for number, part in enumerate(self.parts)
            ],
            axis=0,
        )
        return signal

    def adjoint(self, signal: Signal) -> Signal:
        """Matched filter of every pulse."""
        return np.concatenate([part.adjoint(signal) for part in self.parts])

    def columns(self, support: IndexArray) -> Signal:
        """Templates of the blocks' pulses at the delays of their paths."""
        return self._side_by_side(support, lambda part, local: part.columns(local))

    def slopes(self, support: IndexArray) -> Signal:
        """Derivatives of `columns` with respect to the delay of each block's direct path."""
        return self._side_by_side(support, lambda part, local: part.slopes(local))

    def scores(self, proxy: Signal) -> FloatArray:
        """As of each part."""
        return np.concatenate(
            [part.scores(proxy[self.blocks(number)]) for number, part in enumerate(self.parts)]
        )

    def echo_scores(self, support: IndexArray, coefficients: Signal) -> FloatArray:
        """As of each part."""
        scores = np.zeros(len(support))
        for part, places, local in self._split(support):
            scores[places] = part.echo_scores(local, coefficients[places])
        return scores

    def excluded(self, block: int) -> slice:
        """Band of delays of the same pulse in which two echoes cannot be told apart."""
        begins, ends = self.bands(np.array([block]))
        return slice(int(begins[0]), int(ends[0]))

    def bands(self, support: IndexArray) -> tuple[IndexArray, IndexArray]:
        """Where the bands about blocks begin, and where they end."""
        begins, ends = np.empty_like(support), np.empty_like(support)
        for number, part in enumerate(self.parts):
            start, places = self._starts[number], self._places(number, support)
            local_begins, local_ends = part.bands(support[places] - start)
            begins[places] = start + local_begins
            # A band ends where its pulse's blocks do.
            ends[places] = np.minimum(start + local_ends, self._ends[number])
        return begins, ends

    def rivals(self, block: int) -> IndexArray:
        """Blocks of any pulse that overlaps with the echo.

        Different pulses correlate a little at all delays at which they overlap at all: what is
        left of a block's score is known only when the louder echoes about it are accounted for.
        """
        number, local = self._place(block)
        delays_s = self.parts[number].delays_s(np.array([local]))[0]
        return np.concatenate(
            [
                start + self._overlapping(number, part, delays_s)
                for start, part in zip(self._starts, self.parts, strict=True)
            ]
        )

    # ------------------------------------------------------------------ as of a single pulse

    def moved(self, support: IndexArray, steps_s: FloatArray) -> JointOperator:
        """Return an operator in which the direct paths of `support` are later by `steps_s`."""
        refined = copy.copy(self)
        parts = list(self.parts)
        for number, part in enumerate(self.parts):
            places = self._places(number, support)
            parts[number] = part.moved(support[places] - self._starts[number], steps_s[places])
        refined.parts = tuple(parts)
        return refined

    def block_ranges_m(self, support: IndexArray) -> FloatArray:
        """Half the length of the blocks' direct paths, off the grid where they were moved."""
        ranges_m = np.zeros(len(support))
        for part, places, local in self._split(support):
            ranges_m[places] = part.block_ranges_m(local)
        return ranges_m

    def overlaps(self, support: IndexArray) -> FloatArray:
        """Correlation of the direct echoes of each two blocks, 0 of a block with itself."""
        columns = self.columns(support)[:, :: self.block_size]
        norms = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
        overlaps = np.abs(columns.conj().T @ columns) / np.outer(norms, norms)
        np.fill_diagonal(overlaps, 0.0)
        return np.asarray(overlaps)

    def loudness(self, scores: FloatArray) -> FloatArray:
        """Loudest score of any pulse within a pulse of each block."""
        by_part = [
            part.loudness(scores[self.blocks(number)]) for number, part in enumerate(self.parts)
        ]
        curves = [
            (other.ranges_m, loud)
            for other, loud in zip(self.parts, by_part, strict=True)
            if other.block_count
        ]
        return np.concatenate(
            [
                np.max([np.interp(part.ranges_m, *curve) for curve in curves], axis=0)
                for part in self.parts
            ]
        )

    # ------------------------------------------------------------------ whose block is it

    def _overlapping(
        self, number: int, part: DelayDomainOperator, delays_s: FloatArray
    ) -> IndexArray:
        """Blocks of `part` of which a path overlaps with the pulse of part `number` at delays."""
        own_s = self.parts[number].template.duration_s
        paths_s = part.delays_s(np.arange(part.block_count))[:, :, np.newaxis] - delays_s
        overlaps = (paths_s > -part.template.duration_s) & (paths_s < own_s)
        return np.flatnonzero(overlaps.any(axis=(1, 2)))

    def _place(self, block: int) -> tuple[int, int]:
        number = int(np.searchsorted(self._ends, block, side="right"))
        return number, int(block - self._starts[number])

    def _places(self, number: int, support: IndexArray) -> IndexArray:
        return np.flatnonzero((support >= self._starts[number]) & (support < self._ends[number]))

    def _split(
        self, support: IndexArray
    ) -> Iterator[tuple[DelayDomainOperator, IndexArray, IndexArray]]:
        """Each part, where its blocks stand in the support, and their numbers within the part."""
        for number, part in enumerate(self.parts):
            places = self._places(number, support)
            yield part, places, support[places] - self._starts[number]

    def _side_by_side(
        self,
        support: IndexArray,
        columns_of: Callable[[DelayDomainOperator, IndexArray], Signal],
    ) -> Signal:
        """Columns of the blocks' own parts, in the order of the support."""
        found = [(places, columns_of(part, local)) for part, places, local in self._split(support)]
        dtype = np.result_type(*(columns for _, columns in found))
        joined = np.zeros((self.sample_count, len(support), self.block_size), dtype=dtype)
        for places, columns in found:
            joined[:, places] = columns.reshape(self.sample_count, len(places), self.block_size)
        return joined.reshape(self.sample_count, -1)


#: Echoes on the delay axis, of one pulse or of several.
DelayOperator = DelayDomainOperator | JointOperator
