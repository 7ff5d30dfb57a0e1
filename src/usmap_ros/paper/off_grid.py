"""Objects off the cell centres: the coherent dictionary of cells against the delay domain."""

from typing import Any

import numpy as np

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.paper.part import Part
from usmap_ros.paper.setting import BASEBAND, CELL_M, OBLIQUE, f1_of_sets, hear, method
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.plotting.style import FAINT, ROBOTS, new_figure, styled
from usmap_ros.reconstruction.cell_dictionary import CellDictionary
from usmap_ros.reconstruction.cells import explain
from usmap_ros.reconstruction.reconstructor import reconstruct

#: From the centre of a cell towards its corner: 0 to half a cell.
OFFSETS_M = (0.0, 0.0005, 0.001, 0.002, 0.004, 0.008, 0.017, 0.035, 0.07, 0.17, 0.35, 0.5)
SCENES = 12
OBJECTS = 3
NOISE_STD = 1e-4
#: An echo is right within this of an object's range.
RANGE_TOLERANCE_M = 0.01
WAVELENGTH_M = 343.0 / 50e3


def residual_and_f1() -> Part:
    """Draw residual and F1 of both methods against the offset."""
    dictionary = CellDictionary.for_trace(hear([], BASEBAND, pose=OBLIQUE), CELL_M)
    results = np.array([_at_offset(dictionary, offset_m) for offset_m in OFFSETS_M])
    names = ("cells", "delay_domain")
    numbers: dict[str, Any] = {"offsets_m": list(OFFSETS_M), "wavelength_m": WAVELENGTH_M}
    for column, name in enumerate(names):
        numbers[name] = {
            "relative_residual": results[:, 0, column].tolist(),
            "f1": results[:, 1, column].tolist(),
        }
    with styled():
        figure = new_figure(9.0, 3.6)
        left, right = figure.subplots(1, 2, sharex=True)
        labels = ("cells of 1 m, coherent", "delay domain")
        # A logarithmic axis has no zero: it is drawn at a tenth of a millimetre.
        shown = 1e3 * np.maximum(OFFSETS_M, 1e-4)
        for column, (label, color) in enumerate(zip(labels, ROBOTS, strict=False)):
            left.plot(shown, results[:, 0, column], "o-", color=color, label=label, markersize=4)
            right.plot(shown, results[:, 1, column], "o-", color=color, label=label, markersize=4)
        for axes, title, name in (
            (left, "What is left unexplained", "relative residual"),
            (right, "What is found", "F1"),
        ):
            axes.axvline(
                1e3 * WAVELENGTH_M / 4.0, color=FAINT, linestyle=":", label="a quarter wavelength"
            )
            axes.set_xscale("log")
            axes.set_xticks([0.1, 1.0, 10.0, 100.0], ["0", "1", "10", "100"])
            axes.set(xlabel="offset from the centre of the cell (mm)", ylabel=name, title=title)
            axes.set_ylim(-0.03, 1.08)
            axes.legend()
    return Part("beyond_objects_off_the_centres", numbers, figure)


def _at_offset(dictionary: CellDictionary, offset_m: float) -> FloatArray:
    """Mean residual and F1 of cells and delay domain, shape (2, 2)."""
    generator = np.random.default_rng(1)
    results = []
    for _ in range(SCENES):
        inner = np.flatnonzero(
            (np.abs(dictionary.cells.bearings_rad) < 0.5) & (dictionary.cells.ranges_m > 2.0)
        )
        chosen = _apart(dictionary, generator.permutation(inner))
        direction = generator.uniform(0.0, 2.0 * np.pi, OBJECTS)
        shift = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
        # Half a cell is where its border is nearest: farther, it would be another cell's object.
        objects = dictionary.cells.centers_m[chosen] + 0.98 * offset_m * shift
        trace = hear(objects, BASEBAND, noise_std=NOISE_STD, pose=OBLIQUE)
        cells = explain(dictionary, trace, method())
        delays = reconstruct(trace, ReconstructionParameters())
        results.append(
            [
                [cells.relative_residual, delays.cone.residual],
                [f1_of_sets(cells, objects), _f1_of_ranges(trace, delays.cone.ranges_m, objects)],
            ]
        )
    mean: FloatArray = np.mean(results, axis=0)
    return mean


def _apart(dictionary: CellDictionary, order: np.ndarray) -> list[int]:
    """First cells in `order` whose echoes do not overlap."""
    chosen: list[int] = []
    for cell in order:
        apart = np.abs(dictionary.cells.ranges_m[chosen] - dictionary.cells.ranges_m[cell])
        if np.all(apart > 0.8):
            chosen.append(int(cell))
        if len(chosen) == OBJECTS:
            break
    return chosen


def _f1_of_ranges(trace: EchoTrace, found_m: np.ndarray, objects: FloatArray) -> float:
    truth_m = np.hypot(*(objects - trace.pose.position_m[:2]).T)
    near = np.abs(found_m[:, np.newaxis] - truth_m) <= RANGE_TOLERANCE_M
    right = min(near.any(axis=0).sum(), near.any(axis=1).sum())
    return float(2.0 * right / max(len(found_m) + len(truth_m), 1))
