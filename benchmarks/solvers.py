"""Time and accuracy of the product's reconstruction and of others on the same pings.

Each ping hears three objects off the grid, at least 0.3 m apart in range, with noise of 0.01: I/Q
at 25 kS/s, up to 5 m, and cells of 5 cm.  Beside the product stand the paper's way, which is CoSaMP
on a dense matrix that is built for each ping or given, orthogonal matching pursuit and FISTA of
PyLops and the former of scikit-learn, each on the matrix that is given (`pip install
usmap_ros[bench]` brings them), and a sonar that reports its first echo.
"Found" is the share of objects with an echo within 5 cm of their range, "false" the number of
echoes a ping without an object there, "error" the median distance of the former.  Of these, each
solver is at an operating point of its own: pursuits go on until they have ten columns, the product
stops at what noise alone would exceed once in many pings, and misses objects whose echo is fainter
than that.  "Found at few false" compares them at one: of all that each solver proposes (the product
with a threshold that noise exceeds nine times in ten pings), echoes below one amplitude are left
out, the lowest that leaves no more than one false echo in ten pings.  Times are those of one core.
The limit is one direct matched filter of the samples and one visit of all cells, and the same
filter by an FFT and its inverse.

python benchmarks/solvers.py --pings 20
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from reconstruction import SPARSITY, dense_cosamp, sensing_matrix

from usmap_ros.numerics.compiled import compiled
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.reconstruction.cone_cells import ConeCells
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate

CELL_M = 0.05
#: Ranges that are one echo, and an echo that is an object's.
NEAR_M = 0.05
#: Coefficients below this share of the largest are no objects.
LEAST_SHARE = 0.05
#: False echoes a ping at which solvers are compared, and those that the product is to propose.
FEW_FALSE, MANY_FALSE = 0.1, 0.9
#: Samples of the pulse, in a matched filter.
PULSE_SAMPLES = 8
Ranges = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
#: Ranges of echoes, and their amplitudes as received.
Echoes = tuple[Ranges, Ranges]


def run(pings: int = 20) -> dict[str, Any]:
    """Measure; times are medians in milliseconds a ping."""
    problems = [problem(seed) for seed in range(pings)]
    cells = ConeCells.seen(problems[0][0].pose, problems[0][0].transducer, CELL_M)
    # The pose is the same in all of them, and so is the matrix.
    matrix = sensing_matrix(problems[0][0], cells)
    figures: dict[str, Any] = {"pings": pings, "samples": len(matrix), "cells": matrix.shape[1]}
    for name, solve in solvers(matrix, cells.ranges_m).items():
        solve(problems[0][0])
        spent, found = [], []
        for trace, _ in problems:
            begun_s = time.process_time()
            found.append(solve(trace))
            spent.append(1e3 * (time.process_time() - begun_s))
        figures[f"{name}_ms"] = float(np.median(spent))
        truths = [truth for _, truth in problems]
        figures |= accuracy(name, [ranges_m for ranges_m, _ in found], truths)
        if name == "product":
            found = [many_echoes(trace) for trace, _ in problems]
        figures[f"{name}_found_at_few_false"] = found_at(FEW_FALSE, found, truths)
    figures |= limit(len(matrix), matrix.shape[1])
    figures["times_faster_than_dense_built"] = figures["dense_built_ms"] / figures["product_ms"]
    return figures


class Places(NamedTuple):
    """Where the columns of a matrix are: ranges of their cells, and their norms."""

    ranges_m: Ranges
    norms: Ranges


def problem(seed: int) -> tuple[EchoTrace, Ranges]:
    """A ping, and the ranges of the objects that it hears."""
    rng = np.random.default_rng(seed)
    ranges_m = np.sort(rng.uniform(0.8, 4.0, 3))
    while np.diff(ranges_m).min() < 0.3:
        ranges_m = np.sort(rng.uniform(0.8, 4.0, 3))
    bearings = rng.uniform(-0.3, 0.3, 3)
    points = [
        {"x_m": float(r * np.cos(b)), "y_m": float(r * np.sin(b)), "reflectivity": 1.0}
        for r, b in zip(ranges_m, bearings, strict=True)
    ]
    content = {
        "seed": seed,
        "duration_s": 0.2,
        "world": {"points": points},
        "robots": [
            {
                "name": "robot",
                "motion": {"kind": "waypoints", "waypoints_m": [[0.0, 0.0], [0.1, 0.0]]},
                "transducers": [
                    {
                        "pulse": {"shape": "hann_burst", "carrier_hz": 50e3, "duration_s": 3.2e-4},
                        "beam": {"kind": "linear", "half_angle_rad": 0.698},
                        "max_range_m": 5.0,
                        "receiver": {
                            "encoding": "iq", "sample_rate_hz": 25e3, "noise_std": 0.01,
                        },
                    }
                ],
            }
        ],
    }  # fmt: skip
    _, trace = next(simulate(Scenario.from_mapping(content, "problem")))
    return trace, ranges_m


def echoes(trace: EchoTrace, parameters: ReconstructionParameters) -> Echoes:
    """What the product finds."""
    cone = reconstruct(trace, parameters).cone
    return cone.ranges_m.astype(float), cone.amplitudes.astype(float)


def many_echoes(trace: EchoTrace) -> Echoes:
    """What the product finds if noise may be taken for echoes."""
    return echoes(trace, ReconstructionParameters(false_alarms_per_ping=MANY_FALSE))


def solvers(matrix: ComplexArray, ranges_m: Ranges) -> dict[str, Callable[[EchoTrace], Echoes]]:
    """Ways of finding echoes in a trace."""
    parameters = ReconstructionParameters()
    places = Places(ranges_m, np.linalg.norm(matrix, axis=0))

    def first_echo(trace: EchoTrace) -> Echoes:
        magnitude = np.abs(trace.signal())
        loud = np.flatnonzero(magnitude > 5.0 * trace.noise_std)[:1]
        begins_s = trace.sample_times_s()[loud]
        return 0.5 * trace.channel.sound_speed_m_s * begins_s, magnitude[loud]

    def dense_built(trace: EchoTrace) -> Echoes:
        cells = ConeCells.seen(trace.pose, trace.transducer, CELL_M)
        return clusters(dense_cosamp(sensing_matrix(trace, cells), trace.signal()), places)

    def dense_given(trace: EchoTrace) -> Echoes:
        return clusters(dense_cosamp(matrix, trace.signal()), places)

    found: dict[str, Callable[[EchoTrace], Echoes]] = {
        "product": lambda trace: echoes(trace, parameters),
        "first_echo": first_echo,
        "dense_built": dense_built,
        "dense_given": dense_given,
    }
    if find_spec("pylops"):
        found |= of_pylops(matrix, places)
    if find_spec("sklearn"):
        found["scikit_learn_omp"] = of_scikit_learn(matrix, places)
    return found


def of_pylops(matrix: ComplexArray, places: Places) -> dict[str, Callable[[EchoTrace], Echoes]]:
    """Solvers of PyLops."""
    from pylops import MatrixMult
    from pylops.optimization.sparsity import fista, omp

    operator = MatrixMult(matrix, dtype="complex128")
    step = float(1.0 / np.linalg.norm(matrix, 2) ** 2)

    def by_omp(trace: EchoTrace) -> Echoes:
        noise = trace.noise_std * np.sqrt(len(matrix))
        # PyLops ends in an IndexError where there is nothing to explain.
        if np.linalg.norm(trace.signal()) <= noise:
            return np.empty(0), np.empty(0)
        solution = omp(operator, trace.signal(), niter_outer=SPARSITY, sigma=noise)[0]
        return clusters(np.asarray(solution), places)

    def by_fista(trace: EchoTrace) -> Echoes:
        signal = trace.signal()
        eps = 0.1 * np.abs(matrix.conj().T @ signal).max()
        solution = fista(operator, signal, niter=100, eps=eps, alpha=step)[0]
        return clusters(np.asarray(solution), places)

    return {"pylops_omp": by_omp, "pylops_fista": by_fista}


def of_scikit_learn(matrix: ComplexArray, places: Places) -> Callable[[EchoTrace], Echoes]:
    """Orthogonal matching pursuit of scikit-learn, which has real numbers only."""
    from sklearn.linear_model import orthogonal_mp

    real = np.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]])
    columns = matrix.shape[1]

    def by_omp(trace: EchoTrace) -> Echoes:
        signal = trace.signal()
        parts = np.concatenate([signal.real, signal.imag])
        solution = orthogonal_mp(real, parts, n_nonzero_coefs=2 * SPARSITY)
        return clusters(solution[:columns] + 1j * solution[columns:], places)

    return by_omp


def clusters(coefficients: ComplexArray, places: Places) -> Echoes:
    """Echoes of coefficients, those that are near one another taken for one."""
    strength = np.abs(coefficients)
    order = np.flatnonzero(strength > LEAST_SHARE * strength.max())
    kept: list[int] = []
    for cell in order[np.argsort(-strength[order])]:
        if np.all(np.abs(places.ranges_m[cell] - places.ranges_m[kept]) > NEAR_M):
            kept.append(int(cell))
    return places.ranges_m[kept], strength[kept] * places.norms[kept]


def found_at(false_rate: float, found: list[Echoes], truths: list[Ranges]) -> float:
    """Share of objects that are found if quiet echoes are left out until few are false.

    Parameters
    ----------
    false_rate : float
        False echoes a ping that are tolerated.
    found, truths : list
        Of each ping, echoes and ranges of the objects.
    """
    false, heard = [], []
    for (ranges_m, amplitudes), truth in zip(found, truths, strict=True):
        near = np.abs(np.subtract.outer(truth, ranges_m)) <= NEAR_M
        false += amplitudes[~near.any(axis=0)].tolist()
        heard += [amplitudes[one].max(initial=0.0) for one in near]
    loudest = sorted(false, reverse=True)
    tolerated = int(false_rate * len(truths))
    least = loudest[tolerated] if tolerated < len(loudest) else 0.0
    return float(np.mean(np.array(heard) > least))


def accuracy(name: str, found: list[Ranges], truths: list[Ranges]) -> dict[str, float]:
    """How well the objects were found."""
    errors, false = [], 0
    for ranges_m, truth in zip(found, truths, strict=True):
        apart = np.abs(np.subtract.outer(truth, ranges_m))
        if ranges_m.size:
            nearest = apart.min(axis=1)
            errors += list(nearest[nearest <= NEAR_M])
            false += int(np.count_nonzero(apart.min(axis=0) > NEAR_M))
    return {
        f"{name}_found": len(errors) / sum(map(len, truths)),
        f"{name}_false": false / len(truths),
        f"{name}_error_mm": 1e3 * float(np.median(errors)) if errors else float("nan"),
    }


@compiled
def _filtered(signal: ComplexArray, pulse: ComplexArray, cells: Ranges) -> float:
    """Apply a matched filter, and visit every cell."""
    total = 0.0
    for first in range(len(signal) - len(pulse)):
        product = 0.0j
        for sample in range(len(pulse)):
            product += signal[first + sample] * pulse[sample]
        total += product.real
    for cell in range(len(cells)):
        cells[cell] += total
    return total


def limit(samples: int, cells: int, turns: int = 200) -> dict[str, float]:
    """What no reconstruction can do without."""
    rng = np.random.default_rng(1)
    signal = rng.normal(size=samples) + 1j * rng.normal(size=samples)
    pulse, visited = signal[:PULSE_SAMPLES].copy(), np.zeros(cells)
    spectrum = np.fft.fft(pulse, 2 * samples)
    _filtered(signal, pulse, visited)
    begun_s = time.process_time()
    for _ in range(turns):
        _filtered(signal, pulse, visited)
    direct_s = time.process_time() - begun_s
    begun_s = time.process_time()
    for _ in range(turns):
        np.fft.ifft(np.fft.fft(signal, 2 * samples) * spectrum)
    fft_s = time.process_time() - begun_s
    return {"limit_direct_ms": 1e3 * direct_s / turns, "limit_fft_ms": 1e3 * fft_s / turns}


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pings", type=int, default=20)
    print(json.dumps(run(parser.parse_args().pings), indent=2))


if __name__ == "__main__":
    main()
