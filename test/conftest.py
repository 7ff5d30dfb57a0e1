"""Set up for all tests."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

# Before NumPy is imported: the matrices are small, and the threads of the linear algebra would
# only wait for each other, most of all where several test processes share the machine.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

if TYPE_CHECKING:
    from usmap_ros.reconstruction.operators import SensingOperator


@pytest.fixture(scope="session")
def passes_dot_test() -> Callable[..., bool]:
    """Give a function that tells whether an operator's adjoint is one.

    ⟨Φ x, y⟩ must equal ⟨x, Φᴴ y⟩ for random complex x and y, after the test of the same name in
    Claerbout, "Earth Soundings Analysis" (1992).
    """

    import numpy as np

    def passes(operator: SensingOperator, seed: int, tolerance: float = 1e-10) -> bool:
        generator = np.random.default_rng(seed)
        parts = generator.normal(size=(2, operator.block_count, operator.block_size))
        x = parts[0] + 1j * parts[1]
        parts = generator.normal(size=(2, operator.sample_count))
        y = parts[0] + 1j * parts[1]
        left = complex(np.vdot(operator.forward(x), y))
        right = complex(np.vdot(x, operator.adjoint(y)))
        return abs(left - right) <= tolerance * max(abs(left), abs(right), 1.0)

    return passes
