"""Two transducers on one robot: orientations and pulses that break the symmetry."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.paper.drawing import (
    annotate,
    draw_cells,
    draw_cone_edge,
    draw_objects,
    finish_map,
    share_legend,
)
from usmap_ros.paper.figures_2_3 import in_company
from usmap_ros.paper.part import Part
from usmap_ros.paper.setting import (
    ALIGNED,
    CELL_M,
    SPARSITY,
    SQUARE_PULSE,
    Points,
    SampledPulse,
    hear,
)
from usmap_ros.plotting.style import ROBOTS, new_figure, styled
from usmap_ros.reconstruction.cell_dictionary import CellDictionary, cell_signal
from usmap_ros.reconstruction.cone_cells import ConeCells
from usmap_ros.reconstruction.cosamp import cosamp
from usmap_ros.reconstruction.matrix_operator import (
    MatrixOperator,
    SparseMatrix,
    identical,
    merged,
    same_direction,
)

#: Seen by both transducers of every pair, whichever way they look.
OBJECTS: Points = ((-0.5, 2.5), (1.5, 4.5), (-1.5, 7.5))
_LONG = replace(SQUARE_PULSE, pulse=replace(SQUARE_PULSE.pulse, duration_s=1.7e-3))
_LEFT, _RIGHT = np.deg2rad(9.0), np.deg2rad(-7.0)


@dataclass(frozen=True)
class Pair:
    """Two transducers at one place."""

    #: What makes them different.
    name: str
    yaws_rad: tuple[float, float]
    #: Pulse, encoding and sample rate of each of the two transducers.
    listenings: tuple[SampledPulse, SampledPulse]
    #: Whether they emit at once, so that only the sum of their echoes is received.
    together: bool


PAIRS = (
    Pair("other pulses, one way", (0.0, 0.0), (SQUARE_PULSE, _LONG), together=False),
    Pair("other ways, one pulse", (_LEFT, _RIGHT), (SQUARE_PULSE, SQUARE_PULSE), together=False),
    Pair("other ways and pulses, at once", (_LEFT, _RIGHT), (SQUARE_PULSE, _LONG), together=True),
)


def two_transducers() -> Part:
    """Recover a scene from one pose with each pair, and draw it."""
    numbers: dict[str, Any] = {"objects_m": [list(point) for point in OBJECTS]}
    with styled():
        figure = new_figure(11.0, 4.4)
        panels = figure.subplots(1, len(PAIRS), sharex=True, sharey=True)
        images = []
        for axes, pair in zip(panels, PAIRS, strict=True):
            cells, coefficients, alike = recover(pair)
            at_objects = _weight_at(cells, coefficients)
            numbers[pair.name.replace(",", "").replace(" ", "_")] = {
                "identical_columns": alike,
                "cells": len(cells),
                "weight_at_objects": at_objects,
                "weight_elsewhere": float(coefficients.sum()) - sum(at_objects),
            }
            images.append(draw_cells(axes, cells, coefficients))
            for name, yaw_rad, color in zip(
                ("first", "second"), pair.yaws_rad, ROBOTS, strict=False
            ):
                draw_cone_edge(axes, _turned(yaw_rad), color=color, label=f"{name} transducer")
            draw_objects(axes, OBJECTS)
            finish_map(axes, pair.name.capitalize())
            annotate(axes, f"{alike} of {len(cells)} columns have a twin")
        share_legend(figure, panels[0])
        figure.colorbar(images[0], ax=panels, label="coefficient", shrink=0.7)
    return Part("beyond_two_transducers", numbers, figure)


def recover(pair: Pair) -> tuple[ConeCells, FloatArray, int]:
    """Cells, their coefficients, and how many columns have a twin."""
    dictionaries, signals = [], []
    for yaw_rad, listening in zip(pair.yaws_rad, pair.listenings, strict=True):
        trace = hear(OBJECTS, listening, pose=_turned(yaw_rad))
        dictionaries.append(CellDictionary.for_trace(trace, CELL_M, as_sparse=True))
        signals.append(cell_signal(trace)[0])
    cells, matrices = _aligned(dictionaries)
    if pair.together:
        rows = max(len(signal) for signal in signals)
        matrix = sum(_padded(one, rows) for one in matrices)
        signal = np.sum([np.pad(one, (0, rows - len(one))) for one in signals], axis=0)
    else:
        matrix, signal = sparse.vstack(matrices), np.concatenate(signals)
    operator, generator = MatrixOperator(matrix), np.random.default_rng(0)
    alike = in_company(identical(operator, generator))
    reduced, shares = merged(operator, same_direction(operator, generator))
    solution = cosamp(reduced, signal, SPARSITY, threshold=1e-6, non_negative=True)
    return cells, shares[:, solution.support] @ solution.coefficients[:, 0], alike


def _turned(yaw_rad: float) -> Pose:
    x_m, y_m = ALIGNED.position_m[:2]
    return Pose.planar(x_m, y_m, ALIGNED.yaw_rad + yaw_rad)


def _aligned(dictionaries: list[CellDictionary]) -> tuple[ConeCells, list[SparseMatrix]]:
    """All cells that any transducer sees, and the dictionaries with a column for each of them."""
    both = np.concatenate([_keys(one.cells) for one in dictionaries])
    keys, first = np.unique(both, return_index=True)
    parts = [one.cells for one in dictionaries]
    fields: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts])[first]
        for name in ("rows", "columns", "ranges_m", "bearings_rad", "gains")
    }
    matrices = []
    for one in dictionaries:
        place = np.searchsorted(keys, _keys(one.cells))
        entries = (np.ones(len(place)), (np.arange(len(place)), place))
        selection = sparse.csc_array(entries, shape=(len(place), len(keys)))
        matrices.append(one.matrix @ selection)
    return ConeCells(CELL_M, **fields), matrices


def _keys(cells: ConeCells) -> FloatArray:
    """One number for each cell."""
    keys: FloatArray = 1000.0 * cells.rows.astype(float) + cells.columns
    return keys


def _padded(matrix: SparseMatrix, rows: int) -> SparseMatrix:
    return sparse.csc_array(
        (matrix.data, matrix.indices, matrix.indptr), shape=(rows, matrix.shape[1])
    )


def _weight_at(cells: ConeCells, coefficients: FloatArray) -> list[float]:
    centers = cells.centers_m
    return [
        float(coefficients[np.all(np.isclose(centers, point), axis=1)].sum()) for point in OBJECTS
    ]
