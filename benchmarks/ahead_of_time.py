"""One kernel compiled when the package is built, beside Numba: what it costs and what it gains.

The kernel is the Cholesky factorisation of least squares, in Cython with the options that a build
for one machine could have.  Needs a C compiler and Cython, which the extra "bench" has.
"""

from __future__ import annotations

import importlib.util
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

from usmap_ros.numerics.compiled import OPTIONS
from usmap_ros.reconstruction.sampled.band import factorise

CYTHON = """\
# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True
import numpy as np
from libc.math cimport fmax, sqrt

def factorise(double complex[:, ::1] gram, long long[::1] begins, double ridge):
    cdef double complex[:, ::1] factor = np.empty_like(gram)
    cdef Py_ssize_t row, column, inner, begin
    cdef double complex total
    cdef double pivot, diagonal
    for row in range(gram.shape[0]):
        begin = begins[row]
        pivot = gram[row, row].real * (1.0 + ridge)
        for column in range(begin, row):
            total = gram[row, column]
            for inner in range(max(begin, begins[column]), column):
                total = total - factor[row, inner] * factor[column, inner].conjugate()
            diagonal = factor[column, column].real
            total = total / diagonal if diagonal > 0.0 else 0.0 * total
            factor[row, column] = total
            pivot -= (total * total.conjugate()).real
        factor[row, row] = sqrt(fmax(pivot, 0.5 * ridge * gram[row, row].real))
    return np.asarray(factor)
"""


def measure(size: int = 60) -> dict[str, Any]:
    """Measure: seconds of the processor to compile, microseconds a call."""
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(size, size)) + 1j * rng.normal(size=(size, size))
    gram = columns @ columns.conj().T + size * np.eye(size)
    begins = np.zeros(size, np.int64)

    def call(function: Callable[..., Any]) -> Any:
        return np.tril(function(gram, begins, 1e-10))

    # The first of all loads what Numba compiles with.
    numba.njit(lambda x: x + 1)(1.0)
    by_numba = numba.njit(**OPTIONS)(factorise)
    before = time.process_time()
    expected = call(by_numba)
    numba_s = time.process_time() - before
    with tempfile.TemporaryDirectory() as folder:
        by_cython, cython_s = built(Path(folder))
        np.testing.assert_allclose(call(by_cython), expected, atol=1e-9)
        return {
            "numba_compile_s": numba_s,
            "cython_compile_s": cython_s,
            "numba_us": microseconds(lambda: by_numba(gram, begins, 1e-10)),
            "cython_us": microseconds(lambda: by_cython(gram, begins, 1e-10)),
        }


def built(folder: Path) -> tuple[Callable[..., Any], float]:
    """The kernel in Cython, and what its compilation took of the processor."""
    (folder / "kernel.pyx").write_text(CYTHON)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, "-m", "Cython.Build.Cythonize", "-q", "-i", "kernel.pyx"],
        cwd=folder,
        env={**os.environ, "CFLAGS": "-O3 -march=native -ffast-math -w"},
        stdout=subprocess.DEVNULL,
        check=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    (library,) = folder.glob("kernel.*.so")
    spec = importlib.util.spec_from_file_location("kernel", library)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.factorise, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def microseconds(call: Callable[[], Any], calls: int = 100, turns: int = 7) -> float:
    """Processor time of a call: the least of several turns."""
    spent = []
    for _ in range(turns):
        before = time.process_time()
        for _ in range(calls):
            call()
        spent.append((time.process_time() - before) / calls)
    return 1e6 * min(spent)


if __name__ == "__main__":
    print(json.dumps(measure(), indent=2))
