"""How long reconstruction takes, beside the paper's way on the same traces.

The paper's way is to build the sensing matrix, dense and complex, and to run ten iterations of
CoSaMP on it, as they are defined: every sample of every column, and Φ q with the whole of Φ.
Both run on one core, turn by turn, and what counts is the processor's time, so that whatever
else the machine does changes little.

`by_scene` has the time a ping by encoding and number of echoes, `by_range` that by range, and
`by_cell` that of the product's own version of the paper's dictionary by its cells.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.preparation.valid_part import valid_part
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.reconstruction.cells import reconstruct_cells
from usmap_ros.reconstruction.cone_cells import ConeCells
from usmap_ros.reconstruction.delays import reconstruct_delays
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate

SCENARIOS = Path(__file__).parents[1] / "config/scenarios"
SCENARIO = SCENARIOS / "poles.yaml"
#: Few echoes, many, and few of three paths each; by encoding, with the rate of its samples.
SCENES = ("poles", "room", "floor")
RATES_HZ = {"iq": 25_000.0, "envelope": 25_000.0, "raw": 250_000.0}
CELL_M = 0.05
ITERATIONS = 10
SPARSITY = 15
ComplexArray = NDArray[np.complex128]


def run(pings: int = 60, dense_pings: int = 5) -> dict[str, Any]:
    """Measure; the times are medians in milliseconds a ping."""
    scenario = Scenario.load(SCENARIO)
    traces = [trace for _, trace in islice(simulate(scenario), pings)]
    parameters = ReconstructionParameters()
    for trace in traces[:5]:
        reconstruct(trace, parameters)
    delay_domain, build, solve, cells = [], [], [], []
    every = max(1, pings // dense_pings)
    for trace, *others in (traces[begin : begin + every] for begin in range(0, pings, every)):
        delay_domain.extend(spent_ms([trace, *others], parameters))
        build_ms, solve_ms, shape = dense(trace)
        build.append(build_ms)
        solve.append(solve_ms)
        cells.append(_milliseconds(lambda trace=trace: paper(trace)))
    ours, theirs = float(np.median(delay_domain)), float(np.median(np.add(build, solve)))
    return {
        "pings": pings,
        "dense_pings": len(build),
        "samples": shape[0],
        "cells": shape[1],
        "delay_domain_ms": ours,
        "delay_domain_90_percent_ms": float(np.quantile(delay_domain, 0.9)),
        "dense_build_ms": float(np.median(build)),
        "dense_cosamp_ms": float(np.median(solve)),
        "sparse_cells_ms": float(np.median(cells)),
        "times_faster_than_dense": theirs / ours,
        **by_scene(pings),
        **by_range(pings),
        **by_cell(pings),
    }


def by_scene(pings: int) -> dict[str, float]:
    """Milliseconds a ping by scene and encoding, and echoes in it."""
    figures = {}
    parameters = ReconstructionParameters()
    for scene in SCENES:
        for encoding in RATES_HZ:
            traces = [trace for _, trace in islice(simulate(received(scene, encoding)), pings)]
            reconstruct(traces[0], parameters)
            spent = spent_ms(traces, parameters)
            found = [reconstruct_delays(valid_part(trace), parameters) for trace in traces]
            echoes = [len(one.cone.ranges_m) for one in found]
            most = np.array(echoes) >= np.quantile(echoes, 0.9)
            name = f"{scene}_{encoding}"
            figures[f"{name}_echoes"] = float(np.mean(echoes))
            figures[f"{name}_ms"] = float(spent.mean())
            figures[f"{name}_most_echoes"] = float(np.mean(np.array(echoes)[most]))
            figures[f"{name}_most_echoes_ms"] = float(spent[most].mean())
    return figures


def spent_ms(
    traces: Sequence[EchoTrace], parameters: ReconstructionParameters
) -> NDArray[np.float64]:
    """Milliseconds for each ping: the median of three, for what else runs comes and goes."""
    turns = [
        [_milliseconds(lambda trace=trace: reconstruct(trace, parameters)) for trace in traces]
        for _ in range(3)
    ]
    return np.asarray(np.median(turns, axis=0))


def by_range(pings: int) -> dict[str, float]:
    """Milliseconds a ping, by how far it reaches."""
    return {
        f"range_{range_m:g}_m_ms": _median_ms(islice(simulate(of_range(range_m)), pings))
        for range_m in (2.5, 5.0, 10.0, 20.0)
    }


def by_cell(pings: int) -> dict[str, float]:
    """Milliseconds a ping with the paper's dictionary, by the side of its cells."""
    traces = list(islice(simulate(Scenario.load(SCENARIO)), max(3, pings // 10)))
    figures = {}
    for cell_m in (0.2, 0.1, CELL_M):
        parameters = ReconstructionParameters(dictionary="cells", cell_size_m=cell_m)
        figures[f"cells_of_{1e3 * cell_m:g}_mm_ms"] = _median_ms(traces, parameters)
    return figures


def of_range(range_m: float) -> Scenario:
    """The scenario of poles, with transducers of a range and a world that is as much larger.

    Who means to hear so far sends louder, or lower: at its range, each hears what one of the
    scenario hears at its own, which air and distance would else keep from it.
    """
    scenario = Scenario.load(SCENARIO)
    _, trace = next(simulate(scenario))
    before_m, loss_db_m = trace.transducer.max_range_m, 2.0 * trace.channel.attenuation_db_m
    quieter = (before_m / range_m) ** 2 * 10.0 ** (-loss_db_m * (range_m - before_m) / 20.0)
    content = scenario.model_dump()
    for robot in content["robots"]:
        for transducer in robot["transducers"]:
            transducer["max_range_m"] = range_m
            transducer["receiver"]["noise_std"] *= quieter
    side_m = max(10.0, 2.0 * range_m)
    content["world"]["area_m"] = [0.0, side_m, 0.0, side_m]
    return Scenario.from_mapping(content, "range")


def _median_ms(
    recorded: Iterable[tuple[str, EchoTrace]],
    parameters: ReconstructionParameters | None = None,
) -> float:
    parameters = parameters or ReconstructionParameters()
    traces = [trace for _, trace in recorded]
    reconstruct(traces[0], parameters)
    return float(
        np.median([_milliseconds(lambda one=one: reconstruct(one, parameters)) for one in traces])
    )


def received(scene: str, encoding: str) -> Scenario:
    """A scenario whose transducers all hand out one encoding."""
    content = Scenario.load(SCENARIOS / f"{scene}.yaml").model_dump()
    for robot in content["robots"]:
        for transducer in robot["transducers"]:
            transducer["receiver"].update(encoding=encoding, sample_rate_hz=RATES_HZ[encoding])
    return Scenario.from_mapping(content, scene)


def paper(trace: EchoTrace) -> None:
    """Run the product's own version of the paper's method, on a sparse matrix."""
    parameters = ReconstructionParameters(
        dictionary="cells", cell_size_m=CELL_M, sparsity=SPARSITY, max_iterations=ITERATIONS
    )
    reconstruct_cells(trace, parameters)


def dense(trace: EchoTrace) -> tuple[float, float, tuple[int, int]]:
    """Milliseconds to build Φ and to run CoSaMP on it, and the shape of Φ."""
    cells = ConeCells.seen(trace.pose, trace.transducer, CELL_M)
    started = time.process_time()
    matrix = sensing_matrix(trace, cells)
    built = time.process_time()
    dense_cosamp(matrix, trace.signal())
    solved = time.process_time()
    return 1e3 * (built - started), 1e3 * (solved - built), matrix.shape


def sensing_matrix(trace: EchoTrace, cells: ConeCells) -> ComplexArray:
    """Build Φ of an I/Q trace as its definition reads: every pulse at every sample."""
    pulse, delays_s = trace.transducer.pulse, trace.channel.delays_s(cells.ranges_m)[:, 0]
    amplitudes = cells.gains * trace.channel.amplitudes(cells.ranges_m)[:, 0]
    carrier = amplitudes * np.exp(-2j * np.pi * pulse.carrier_hz * delays_s)
    matrix = pulse.window(trace.sample_times_s()[:, np.newaxis] - delays_s) * carrier
    # CoSaMP compares columns by their products with the residual, and so presumes a norm of 1;
    # without it a cell at 0.3 m outweighs one at 3 m a hundredfold.
    norms = np.linalg.norm(matrix, axis=0)
    matrix /= np.where(norms > 0.0, norms, 1.0)
    return matrix


def dense_cosamp(matrix: ComplexArray, signal: ComplexArray) -> ComplexArray:
    """Run the given number of CoSaMP iterations of Needell & Tropp (2009), algorithm 2.1."""
    coefficients = np.zeros(matrix.shape[1], dtype=complex)
    residual = signal
    adjoint = matrix.conj().T
    for _ in range(ITERATIONS):
        proxy = np.abs(adjoint @ residual)
        found = np.argpartition(-proxy, 2 * SPARSITY)[: 2 * SPARSITY]
        merged = np.union1d(np.flatnonzero(coefficients), found)
        fitted = np.linalg.lstsq(matrix[:, merged], signal, rcond=None)[0]
        order = np.argsort(-np.abs(fitted))[:SPARSITY]
        coefficients[:] = 0.0
        coefficients[merged[order]] = fitted[order]
        residual = signal - matrix @ coefficients
    return coefficients


def _milliseconds(call: Any) -> float:
    started = time.process_time()
    call()
    return 1e3 * (time.process_time() - started)
