"""What a solver needs to know of a sensing matrix Φ, without Φ itself."""

from __future__ import annotations

from typing import Protocol

from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal


class SensingOperator(Protocol):
    """The sensing matrix Φ as a linear operator on blocks of coefficients.

    A *block* is what stands or falls together: one column of Φ, or the few columns of one
    object's paths over the floor.  Coefficients have the shape (blocks, block_size).
    """

    @property
    def sample_count(self) -> int:
        """Rows of Φ."""

    @property
    def block_count(self) -> int:
        """Blocks of columns of Φ."""

    @property
    def block_size(self) -> int:
        """Columns in a block."""

    def forward(self, coefficients: Signal) -> Signal:
        """Φ x: coefficients (blocks, block_size) to a signal (samples,)."""

    def adjoint(self, signal: Signal) -> Signal:
        """Φᴴ r: a signal (samples,) to a proxy (blocks, block_size)."""

    def columns(self, support: IndexArray) -> Signal:
        """Columns of the blocks in `support`, shape (samples, len(support) * block_size)."""

    def scores(self, proxy: Signal) -> FloatArray:
        """How well each block by itself explains the signal that `proxy` came from.

        The amplitude of the best fit times the norm of the block, shape (blocks,); for
        white noise of standard deviation σ the scores are of the order of σ.
        """

    def echo_scores(self, support: IndexArray, coefficients: Signal) -> FloatArray:
        """Scores of what the blocks of `support` contribute with these coefficients."""

    def excluded(self, block: int) -> slice:
        """Blocks too much like `block` ever to stand beside it; it is among them."""

    def rivals(self, block: int) -> slice | IndexArray:
        """Blocks that may owe their score to the same part of the signal as `block`.

        They are not taken up together with it, but may be later, by what it leaves over.
        """
