"""Total variation, and a sparse number of walls: the analysis form on a scene that has walls."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.paper.drawing import annotate, draw_cells, draw_cone_edge, finish_map
from usmap_ros.paper.part import Part, statement
from usmap_ros.paper.setting import BASEBAND, OBLIQUE, f1, hear
from usmap_ros.plotting.style import ROBOTS, TRUTH, new_figure, styled
from usmap_ros.reconstruction.cell_dictionary import CellDictionary
from usmap_ros.reconstruction.matrix_operator import MatrixOperator
from usmap_ros.reconstruction.problem import Problem
from usmap_ros.reconstruction.solvers import basis_pursuit, few_walls, total_variation

CELL_M = 0.5
LISTENING = replace(BASEBAND, max_range_m=6.0)
#: A wall along the grid, one across it that begins there, and an object by itself.
TRUE_CELLS = [
    *((x, 4.25) for x in np.arange(-0.75, 2.5, 0.5)),
    *((2.25, y) for y in (2.75, 3.25, 3.75)),
    (0.25, 2.25),
]
SOLVERS: dict[str, Callable[[Problem], FloatArray]] = {
    "least l1 norm (2)": basis_pursuit,
    "total variation (3)": total_variation,
    "fewest walls": few_walls,
}
NOISE_STDS = (0.002, 0.005, 0.01, 0.02)
SAMPLES = (20, 25, 30, 35, 40, 50)
TRIALS = 3


def walls_and_an_object() -> Part:
    """Compare equations (2) and (3) and the walls' operator over noise and samples."""
    dictionary = CellDictionary.for_trace(hear([], LISTENING, pose=OBLIQUE), CELL_M, as_sparse=True)
    truth = _truth(dictionary)
    noisy = {name: _over_noise(dictionary, truth, name) for name in SOLVERS}
    sampled = {name: _over_samples(dictionary, truth, name) for name in SOLVERS}
    errors = {name: [_error(found, truth) for found in images] for name, images in noisy.items()}
    numbers: dict[str, Any] = {
        "noise_stds": list(NOISE_STDS),
        "relative_error": errors,
        "f1": {
            name: [f1(np.flatnonzero(found >= 0.5), np.flatnonzero(truth)) for found in images]
            for name, images in noisy.items()
        },
        "random_samples": list(SAMPLES),
        "cells": len(truth),
        "share_recovered": sampled,
        "caption": _caption(errors, sampled),
    }
    return Part("beyond_walls", numbers, _figure(dictionary, noisy, errors, sampled))


def _figure(
    dictionary: CellDictionary,
    noisy: dict[str, list[FloatArray]],
    errors: dict[str, list[float]],
    sampled: dict[str, list[float]],
) -> Figure:
    with styled():
        figure = new_figure(11.0, 6.6)
        grid = figure.add_gridspec(2, 6, height_ratios=[1.4, 1.0])
        squares = []
        for number, (name, images) in enumerate(noisy.items()):
            axes = figure.add_subplot(grid[0, 2 * number : 2 * number + 2])
            squares.append(draw_cells(axes, dictionary.cells, images[-1]))
            draw_cone_edge(axes, OBLIQUE, LISTENING.max_range_m)
            axes.plot(*np.transpose(TRUE_CELLS), "o", color=TRUTH, markersize=3, label="occupied")
            finish_map(axes, name[0].upper() + name[1:])
            annotate(axes, f"noise {NOISE_STDS[-1]:g}: error {errors[name][-1]:.2f}")
        figure.axes[0].legend(loc="lower left")
        figure.colorbar(squares[0], ax=figure.axes, label="coefficient", shrink=0.8)
        left, right = figure.add_subplot(grid[1, :3]), figure.add_subplot(grid[1, 3:])
        for name, color in zip(SOLVERS, ROBOTS, strict=False):
            left.plot(NOISE_STDS, errors[name], "o-", color=color, label=name)
            right.plot(SAMPLES, sampled[name], "o-", color=color, label=name)
        left.set(xlabel="noise (RMS)", ylabel="‖q − truth‖ / ‖truth‖", title="Error over noise")
        right.set(xlabel="random samples of the trace", ylabel="share of trials")
        right.set_title("Exact recovery without noise")
        left.legend()
    return figure


def _caption(errors: dict[str, list[float]], sampled: dict[str, list[float]]) -> dict[str, Any]:
    cells, variation, walls = SOLVERS
    return {
        "fewest walls have the least error at any noise": statement(
            all(errors[walls][i] < min(errors[cells][i], errors[variation][i]) for i in range(4))
        ),
        "walls come back from fewer samples than single cells": statement(
            sum(sampled[walls]) > sum(sampled[cells])
        ),
    }


def _truth(dictionary: CellDictionary) -> FloatArray:
    truth = np.zeros(len(dictionary.cells))
    for place in TRUE_CELLS:
        truth[np.all(np.isclose(dictionary.cells.centers_m, place), axis=1)] = 1.0
    return truth


def _over_noise(dictionary: CellDictionary, truth: FloatArray, name: str) -> list[FloatArray]:
    """Images from the whole trace, for each noise."""
    images = []
    for noise_std in NOISE_STDS:
        part_std = noise_std / np.sqrt(2.0)
        noise = part_std * np.random.default_rng(0).normal(size=dictionary.sample_count)
        problem = Problem(
            dictionary,
            dictionary.matrix @ truth + noise,
            sparsity=len(truth),
            tolerance=part_std * np.sqrt(dictionary.sample_count),
            places=dictionary.cells.places,
        )
        images.append(SOLVERS[name](problem))
    return images


def _over_samples(dictionary: CellDictionary, truth: FloatArray, name: str) -> list[float]:
    """Share of trials in which the image is recovered from random samples of the trace."""
    return [
        float(
            np.mean(
                [
                    _recovered(
                        dictionary, truth, name, np.random.default_rng([trial, samples]), samples
                    )
                    for trial in range(TRIALS)
                ]
            )
        )
        for samples in SAMPLES
    ]


def _recovered(
    dictionary: CellDictionary,
    truth: FloatArray,
    name: str,
    generator: np.random.Generator,
    samples: int,
) -> bool:
    signs = generator.choice([-1.0, 1.0], (samples, dictionary.sample_count))
    mixed = MatrixOperator(np.asarray(signs @ dictionary.matrix))
    problem = Problem(
        mixed, mixed.matrix @ truth, sparsity=len(truth), places=dictionary.cells.places
    )
    return _error(SOLVERS[name](problem), truth) < 0.01


def _error(found: FloatArray, truth: FloatArray) -> float:
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))
