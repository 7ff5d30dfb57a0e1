"""What coefficients may be: reflectivities, whole numbers of objects, or yes and no."""

from typing import Any

import numpy as np

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.paper.part import Part
from usmap_ros.paper.setting import BASEBAND, CELL_M, OBLIQUE, hear, method
from usmap_ros.plotting.style import FAINT, ROBOTS, new_figure, styled
from usmap_ros.reconstruction.cell_dictionary import CellDictionary
from usmap_ros.reconstruction.cells import explain

NOISE_STD = 0.003
#: Ranges (m) along the axis near which the objects stand.
RANGES_M = (2.0, 3.5, 5.0, 6.5, 8.0)
SCENES = {
    "reflectivities differ": (0.4, 1.0, 1.6, 0.7, 2.2),
    "one object in a cell, or two": (1.0, 1.0, 2.0, 1.0, 2.0),
    "one object in a cell": (1.0, 1.0, 1.0, 1.0, 1.0),
}
KINDS = {"not negative": "cosamp", "whole": "integer", "binary": "binary"}


def kinds_of_coefficients() -> Part:
    """Recover three scenes with three kinds of coefficients."""
    dictionary = CellDictionary.for_trace(hear([], BASEBAND, pose=OBLIQUE), CELL_M)
    chosen = _cells_near_axis(dictionary)
    centers_m = dictionary.cells.centers_m[chosen]
    numbers: dict[str, Any] = {"noise_std": NOISE_STD}
    with styled():
        figure = new_figure(10.0, 3.4)
        panels = figure.subplots(1, len(SCENES), sharey=True)
        for axes, (scene, truth) in zip(panels, SCENES.items(), strict=True):
            trace = hear(
                centers_m, BASEBAND, reflectivities=truth, noise_std=NOISE_STD, pose=OBLIQUE
            )
            place = np.arange(len(truth))
            axes.bar(place, truth, 0.9, color="#e3e8ec", label="truth")
            numbers[scene] = {"truth": list(truth)}
            for number, (kind, solver) in enumerate(KINDS.items()):
                found = explain(dictionary, trace, method(solver=solver))
                values = found.coefficients[chosen]
                numbers[scene][kind] = _numbers(values, found.coefficients, truth)
                numbers[scene][kind]["relative_residual"] = found.relative_residual
                axes.plot(
                    place + 0.22 * (number - 1),
                    values,
                    "osD"[number],
                    markersize=6,
                    color=ROBOTS[number],
                    label=kind,
                )
            axes.set_xticks(place, [f"{range_m:.1f}" for range_m in _ranges_m(dictionary, chosen)])
            axes.set(xlabel="range of the object (m)", title=scene.capitalize())
            axes.axhline(0.0, color=FAINT, linewidth=0.8)
        panels[0].set_ylabel("coefficient")
        panels[0].legend()
    return Part("beyond_kinds_of_coefficients", numbers, figure)


def _cells_near_axis(dictionary: CellDictionary) -> list[int]:
    cells = dictionary.cells
    score = [
        np.abs(cells.ranges_m - wanted) + 2.0 * np.abs(cells.bearings_rad) for wanted in RANGES_M
    ]
    return [int(np.argmin(one)) for one in score]


def _ranges_m(dictionary: CellDictionary, chosen: list[int]) -> FloatArray:
    ranges_m: FloatArray = dictionary.cells.ranges_m[chosen]
    return ranges_m


def _numbers(
    values: FloatArray, everything: FloatArray, truth: tuple[float, ...]
) -> dict[str, Any]:
    return {
        "coefficients": values.tolist(),
        "weight_elsewhere": float(everything.sum() - values.sum()),
        "rms_error": float(np.sqrt(np.mean((values - truth) ** 2))),
    }
