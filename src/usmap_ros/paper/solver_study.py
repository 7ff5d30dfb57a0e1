"""The solvers that the paper names, compared: a table, and where exact recovery ends."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.paper.drawing import COEFFICIENT
from usmap_ros.paper.part import Part
from usmap_ros.paper.setting import (
    BASEBAND,
    CELL_M,
    OBLIQUE,
    f1_of_sets,
    found_sets,
    hear,
    method,
    sets_of,
)
from usmap_ros.parameters.pipeline import SolverName
from usmap_ros.plotting.style import INK, ROBOTS, new_figure, styled
from usmap_ros.reconstruction.cell_dictionary import CellDictionary
from usmap_ros.reconstruction.cells import explain
from usmap_ros.reconstruction.matrix_operator import MatrixOperator, merged, same_direction
from usmap_ros.reconstruction.problem import Problem
from usmap_ros.reconstruction.solvers import solve

NAMES: dict[SolverName, str] = {
    "cosamp": "CoSaMP",
    "omp": "OMP",
    "l1": "least l1 norm",
    "tv": "total variation",
    "walls": "fewest walls",
    "nnls": "NNLS",
}
NOISE_STDS = (0.0, 0.001, 0.003, 0.01)
OBJECT_COUNTS = (2, 4, 8)
SCENES = 5
#: Of the phase transition: objects k, samples m, and scenes for each pair.
SPARSITIES = (1, 2, 4, 8, 16, 24)
SAMPLES = (16, 24, 32, 48, 64, 96)
TRIALS = 4
_MILLISECONDS = (1, 2, 5, 10, 20, 50, 100, 200)


def table() -> Part:
    """Compare support, F1, residual and time over noise and number of objects."""
    dictionary = CellDictionary.for_trace(hear([], BASEBAND, pose=OBLIQUE), CELL_M)
    solvers = list(NAMES)
    rows = [
        {"solver": solver, "noise_std": noise_std, "objects": count}
        | _compared(dictionary, solver, noise_std, count)
        for solver in solvers
        for noise_std in NOISE_STDS
        for count in OBJECT_COUNTS
    ]
    numbers: dict[str, Any] = {"scenes": SCENES, "rows": rows, "summary": _summary(rows, solvers)}
    with styled():
        figure = new_figure(11.0, 3.4)
        panels = figure.subplots(1, 3)
        for axes, key, title, name in zip(
            panels,
            ("support_found", "f1", "milliseconds"),
            ("Support found exactly", "F1", "Processor time"),
            ("share of the scenes", "mean over the scenes", "median for a ping (ms)"),
            strict=True,
        ):
            _draw_over_noise(axes, rows, solvers, key)
            axes.set(title=title, xlabel="noise (RMS)", ylabel=name)
        panels[2].set_yscale("log")
        panels[2].set_yticks(_MILLISECONDS, [str(time_ms) for time_ms in _MILLISECONDS])
        panels[2].minorticks_off()
        panels[2].legend(loc="upper left", bbox_to_anchor=(1.02, 1.0))
    return Part("solvers_table", numbers, figure)


def phase_transition() -> Part:
    """Probability of exact support recovery against objects and samples."""
    solvers = [solver for solver in NAMES if solver not in ("tv", "walls")]
    dictionary = CellDictionary.for_trace(hear([], BASEBAND, pose=OBLIQUE), CELL_M)
    operator, _ = merged(dictionary, same_direction(dictionary, np.random.default_rng(0)))
    places = np.stack([dictionary.cells.rows, dictionary.cells.columns], axis=-1)
    _, first = np.unique(same_direction(dictionary, np.random.default_rng(0)), return_index=True)
    found = {
        solver: np.array(
            [
                [_recovered(operator, places[first], solver, k, m) for m in SAMPLES]
                for k in SPARSITIES
            ]
        )
        for solver in solvers
    }
    numbers = {
        "objects": list(SPARSITIES),
        "samples": list(SAMPLES),
        "cells": operator.block_count,
        "trials": TRIALS,
        "probability": {solver: shares.tolist() for solver, shares in found.items()},
    }
    with styled():
        figure = new_figure(2.3 * len(solvers) + 1.0, 3.0)
        panels = np.atleast_1d(figure.subplots(1, len(solvers), sharey=True))
        look: dict[str, Any] = {"cmap": COEFFICIENT, "vmin": 0.0, "vmax": 1.0}
        images = []
        for axes, solver in zip(panels, solvers, strict=True):
            images.append(axes.imshow(found[solver], origin="lower", aspect="auto", **look))
            axes.contour(found[solver], levels=[0.5], colors=[ROBOTS[0]], linewidths=1.5)
            axes.plot([], [], color=ROBOTS[0], label="one half")
            axes.set_xticks(range(len(SAMPLES)), [str(m) for m in SAMPLES], rotation=60, fontsize=7)
            axes.set_yticks(range(len(SPARSITIES)), [str(k) for k in SPARSITIES])
            axes.set(title=NAMES[solver], xlabel="random samples m")
            axes.grid(visible=False)
        panels[0].set_ylabel("objects k")
        panels[0].legend(loc="upper left", labelcolor=INK)
        figure.colorbar(images[0], ax=panels, label="probability of exact support")
    return Part("solvers_phase_transition", numbers, figure)


def _compared(
    dictionary: CellDictionary, solver: SolverName, noise_std: float, count: int
) -> dict[str, float]:
    """Means over scenes; processor time, the median, in milliseconds."""
    support, scores, residuals, times_ms = [], [], [], []
    for objects, seed in _scenes(dictionary, count):
        trace = hear(objects, BASEBAND, noise_std=noise_std, pose=OBLIQUE, seed=seed)
        started = time.process_time()
        found = explain(dictionary, trace, method(solver=solver))
        times_ms.append(1e3 * (time.process_time() - started))
        support.append(np.array_equal(found_sets(found), sets_of(found, objects)))
        scores.append(f1_of_sets(found, objects))
        residuals.append(found.relative_residual)
    return {
        "support_found": float(np.mean(support)),
        "f1": float(np.mean(scores)),
        "relative_residual": float(np.mean(residuals)),
        "milliseconds": float(np.median(times_ms)),
    }


def _scenes(dictionary: CellDictionary, count: int) -> Iterator[tuple[FloatArray, int]]:
    """Objects at the centres of random cells, the same for every solver."""
    for seed in range(SCENES):
        generator = np.random.default_rng([seed, count])
        chosen = generator.choice(len(dictionary.cells), count, replace=False)
        yield dictionary.cells.centers_m[chosen], seed


def _summary(rows: list[dict[str, Any]], solvers: list[SolverName]) -> list[dict[str, Any]]:
    """One row for each solver: means over everything, and the median time."""
    summary = []
    for solver in solvers:
        own = [row for row in rows if row["solver"] == solver]
        means = {
            key: float(np.mean([row[key] for row in own]))
            for key in ("support_found", "f1", "relative_residual")
        }
        milliseconds = float(np.median([row["milliseconds"] for row in own]))
        summary.append({"solver": solver} | means | {"milliseconds": milliseconds})
    return summary


def _draw_over_noise(
    axes: Axes, rows: list[dict[str, Any]], solvers: list[SolverName], key: str
) -> None:
    place = np.arange(len(NOISE_STDS))
    width = 0.8 / len(solvers)
    for number, (solver, color) in enumerate(zip(solvers, ROBOTS, strict=False)):
        values = [
            np.mean(
                [row[key] for row in rows if (row["solver"], row["noise_std"]) == (solver, std)]
            )
            for std in NOISE_STDS
        ]
        offset = (number - 0.5 * (len(solvers) - 1)) * width
        axes.bar(place + offset, values, 0.9 * width, color=color, label=NAMES[solver])
    axes.set_xticks(place, [f"{std:g}" for std in NOISE_STDS])


def _recovered(
    operator: MatrixOperator, places: IndexArray, solver: SolverName, k: int, m: int
) -> float:
    """Share of scenes of k objects whose support comes back from m random samples.

    A random sample is the trace mixed with random signs, as a random demodulator does
    (Tropp, Laska, Duarte, Romberg & Baraniuk, IEEE Trans. Inf. Theory 56 (2010) 520-544):
    samples picked at random would miss most echoes altogether, because they are short.
    """
    right = 0
    for trial in range(TRIALS):
        generator = np.random.default_rng([trial, k, m])
        signs = generator.choice([-1.0, 1.0], (m, operator.sample_count))
        matrix = signs @ (operator.matrix / operator.norms)
        truth = np.sort(generator.choice(operator.block_count, k, replace=False))
        signal = matrix[:, truth] @ generator.uniform(0.5, 1.5, k)
        problem = Problem(
            MatrixOperator(matrix),
            signal,
            sparsity=k,
            tolerance=1e-6 * float(np.linalg.norm(signal)),
            threshold=1e-6 * float(np.linalg.norm(signal)),
            places=places,
        )
        right += np.array_equal(solve(problem, solver).support, truth)
    return right / TRIALS
