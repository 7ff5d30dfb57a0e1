"""Coefficients that make the algorithm choose one of two mirrored cells.

"When there is redundancy, integer constraints can be imposed on the coefficients to encourage the
algorithm to only choose one of the cells. Of course, […] there is no guarantee that the correct
cell will be selected, only that a single cell will show up in the reconstruction." (section 3)
"""

from typing import Any

import numpy as np

from usmap_ros.numerics.geometry import Pose
from usmap_ros.paper.drawing import annotate, draw_cells, draw_cone_edge, draw_objects, finish_map
from usmap_ros.paper.part import Part, statement
from usmap_ros.paper.setting import (
    ALIGNED,
    OBLIQUE,
    SQUARE_PULSE,
    Points,
    coefficients_by_cell,
    hear,
    method,
    spent,
)
from usmap_ros.parameters.pipeline import SolverName
from usmap_ros.plotting.style import new_figure, styled
from usmap_ros.reconstruction.cells import CellReconstruction, reconstruct_cells

#: Two cells that are mirror images of each other for the aligned sensor.
LEFT, RIGHT = (-0.5, 3.5), (1.5, 3.5)
SENSORS: dict[str, Pose] = {"aligned": ALIGNED, "oblique": OBLIQUE}
SCENES: dict[str, Points] = {"one object": (LEFT,), "two in mirrored cells": (LEFT, RIGHT)}
KINDS: dict[str, SolverName] = {"not negative": "cosamp", "integer": "integer", "binary": "binary"}
#: Coefficients of each kind for the aligned sensor; the oblique one finds what is there.
ALIGNED_COEFFICIENTS: dict[tuple[str, str], dict[tuple[float, float], float]] = {
    ("one object", "not negative"): {LEFT: 0.5, RIGHT: 0.5},
    ("one object", "integer"): {RIGHT: 1.0},
    ("one object", "binary"): {RIGHT: 1.0},
    ("two in mirrored cells", "not negative"): {LEFT: 1.0, RIGHT: 1.0},
    ("two in mirrored cells", "integer"): {RIGHT: 2.0},
    ("two in mirrored cells", "binary"): {LEFT: 1.0, RIGHT: 1.0},
}


def choosing_a_cell() -> Part:
    """Recover one object, and two in mirrored cells, with each kind and either sensor."""
    numbers: dict[str, Any] = {"caption": {}}
    columns = [(sensor, scene) for sensor in SENSORS for scene in SCENES]
    with styled():
        figure = new_figure(12.0, 8.0)
        panels = figure.subplots(len(KINDS), len(columns), sharex=True, sharey=True)
        squares = []
        for row, (kind, solver) in enumerate(KINDS.items()):
            for column, (sensor, scene) in enumerate(columns):
                axes, objects, pose = panels[row, column], SCENES[scene], SENSORS[sensor]
                found = reconstruct_cells(
                    hear(objects, SQUARE_PULSE, pose=pose), method(solver=solver)
                )
                numbers[f"{sensor}, {scene}, {kind}"] = _numbers(found)
                expected = dict.fromkeys(objects, 1.0)
                if sensor == "aligned":
                    expected = ALIGNED_COEFFICIENTS[scene, kind]
                numbers["caption"][f"{sensor}, {scene}, {kind}"] = _as_expected(found, expected)
                squares.append(draw_cells(axes, found.dictionary.cells, found.coefficients, 2.0))
                draw_cone_edge(axes, pose)
                draw_objects(axes, objects)
                finish_map(axes, "" if row else f"{sensor.capitalize()}, {scene}")
                axes.set_ylabel(f"{kind}: y (m)" if column == 0 else "")
                axes.set_xlabel("x (m)" if row == len(KINDS) - 1 else "")
                annotate(
                    axes, f"cells: {spent(found)}, residual: {found.relative_residual:.0e} of ‖y‖"
                )
        panels[0, 0].set(xlim=(-3.0, 4.0), ylim=(-0.3, 5.6))
        figure.colorbar(squares[0], ax=panels, label="coefficient", shrink=0.6)
    return Part("beyond_choosing_a_cell", numbers, figure)


def _numbers(found: CellReconstruction) -> dict[str, Any]:
    return {
        "cells": spent(found),
        "coefficients": coefficients_by_cell(found),
        "relative_residual": found.relative_residual,
    }


def _as_expected(
    found: CellReconstruction, expected: dict[tuple[float, float], float]
) -> dict[str, Any]:
    """Whether exactly these cells have these coefficients, and the trace is explained whole."""
    wanted = np.zeros(len(found.coefficients))
    for place, value in expected.items():
        wanted[np.all(np.isclose(found.dictionary.cells.centers_m, place), axis=1)] = value
    return statement(
        np.allclose(found.coefficients, wanted, atol=1e-6) and found.relative_residual < 1e-6,
        cells=len(expected),
        relative_residual=found.relative_residual,
    )
