"""Figure 7: sinusoids and the floor.  Figure 8: a sensing matrix with and without its paths."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usmap_ros.arrays import IndexArray
from usmap_ros.paper.drawing import (
    annotate,
    draw_cells,
    draw_cone,
    draw_objects,
    draw_signal,
    finish_map,
)
from usmap_ros.paper.part import Part
from usmap_ros.paper.setting import (
    ALIGNED,
    CELL_M,
    CONCRETE,
    MIRROR_IMAGES,
    OBJECTS,
    SINUSOID,
    coefficients_by_cell,
    f1_of_sets,
    found_sets,
    hear,
    method,
    sets_of,
)
from usmap_ros.plotting.style import FAINT, RESIDUAL, ROBOTS, new_figure, styled
from usmap_ros.reconstruction.cell_dictionary import CellDictionary
from usmap_ros.reconstruction.cells import CellReconstruction, explain, reconstruct_cells
from usmap_ros.reconstruction.matrix_operator import identical, same_direction
from usmap_ros.trace import EchoTrace


def interference() -> Part:
    """Draw figure 7: what is received without and with the floor."""
    traces = {"without a floor": hear(OBJECTS, SINUSOID), "with a floor 1 m below": _over_floor()}
    with styled():
        figure = new_figure(9.0, 4.6)
        panels = figure.subplots(2, 1, sharex=True, sharey=True)
        for axes, (name, trace) in zip(panels, traces.items(), strict=True):
            draw_signal(axes, trace.sample_times_s(), trace.signal(), name)
            _mark_paths(axes, trace)
            axes.set_title(f"Sinusoids at 50 kHz {name}")
            axes.set_ylim(-0.12, 0.12)
            axes.legend(loc="upper right")
        panels[0].set_xlabel("")
    energy = {name: float(np.sum(trace.signal() ** 2)) for name, trace in traces.items()}
    numbers = {
        "relative_energy_of_the_floor": energy["with a floor 1 m below"] / energy["without a floor"]
        - 1.0,
        "path_delays_ms": (1e3 * CONCRETE.delays_s(_ranges_m())).tolist(),
        "path_amplitudes": CONCRETE.amplitudes(_ranges_m()).tolist(),
    }
    return Part("figure_7_floor_interference", numbers, figure)


def two_matrices() -> Part:
    """Draw figure 8: maps and residuals with the simple Φ and with the one of all paths."""
    trace = _over_floor()
    found = {
        "simple": reconstruct_cells(trace, method(), floor=False),
        "multipath": reconstruct_cells(trace, method()),
    }
    numbers: dict[str, Any] = {name: _numbers(one) for name, one in found.items()}
    numbers["random_scenes"] = random_scenes(40)
    return Part("figure_8_simple_and_multipath", numbers, _comparison(trace, found))


def random_scenes(count: int) -> dict[str, float]:
    """Share of the objects found, and mean residual, over scenes of three random cells.

    Cells as far away as one that the beam reaches better are left out: a weak object in the
    other explains all that an ideal one in them would return.
    """
    silent = hear([], SINUSOID, channel=CONCRETE)
    shares: dict[str, float] = {}
    for name, floor in (("simple", False), ("multipath", True)):
        dictionary = CellDictionary.for_trace(silent, CELL_M, floor=floor, as_sparse=True)
        generator = np.random.default_rng(3)
        right, residual = 0, 0.0
        for _ in range(count):
            chosen = generator.choice(_unmistakable(dictionary), 3, replace=False)
            objects = dictionary.cells.centers_m[chosen]
            trace = hear(objects, SINUSOID, channel=CONCRETE)
            found = explain(dictionary, trace, method())
            truth = sets_of(found, objects)
            right += int(np.count_nonzero(np.isin(truth, found_sets(found))))
            residual += found.relative_residual
        shares[f"{name}_found"] = right / (3.0 * count)
        shares[f"{name}_relative_residual"] = residual / count
    return shares


def _unmistakable(dictionary: CellDictionary) -> IndexArray:
    """Cells whose column is a multiple of equal ones only."""
    equal = identical(dictionary, np.random.default_rng(0))
    parallel = same_direction(dictionary, np.random.default_rng(0))
    return np.flatnonzero(np.bincount(equal)[equal] == np.bincount(parallel)[parallel])


def _over_floor() -> EchoTrace:
    return hear(OBJECTS, SINUSOID, channel=CONCRETE)


def _ranges_m() -> np.ndarray:
    offsets = np.asarray(OBJECTS) - ALIGNED.position_m[:2]
    return np.asarray(np.hypot(*offsets.T))


def _numbers(found: CellReconstruction) -> dict[str, object]:
    seen = found_sets(found)
    return {
        "relative_residual": found.relative_residual,
        "residual_norm": float(np.linalg.norm(found.residual)),
        "f1": f1_of_sets(found, OBJECTS),
        "near_found": bool(np.isin(sets_of(found, OBJECTS[:1]), seen).all()),
        "middle_found": bool(np.isin(sets_of(found, OBJECTS[1:2]), seen).all()),
        "far_found": bool(np.isin(sets_of(found, OBJECTS[2:]), seen).all()),
        "coefficients": coefficients_by_cell(found),
    }


def _mark_paths(axes: Axes, trace: EchoTrace) -> None:
    """Mark when each path of each object begins."""
    delays_ms = 1e3 * trace.channel.delays_s(_ranges_m())
    names = ["direct", "one way over the floor", "both ways over the floor"]
    for path, name in enumerate(names[: delays_ms.shape[1]]):
        for number, delay_ms in enumerate(delays_ms[:, path]):
            axes.axvline(
                delay_ms,
                color=ROBOTS[path + 1],
                linewidth=1.0,
                linestyle=(0, (4, 2)),
                label=name if number == 0 else None,
                zorder=1,
            )


def _comparison(trace: EchoTrace, found: dict[str, CellReconstruction]) -> Figure:
    with styled():
        figure = new_figure(9.0, 6.2)
        maps, signals = figure.subplots(2, 2, height_ratios=[1.9, 1.0])
        squares = []
        for column, (name, one) in enumerate(found.items()):
            plan, signal = maps[column], signals[column]
            draw_cone(plan, ALIGNED)
            squares.append(draw_cells(plan, one.dictionary.cells, one.coefficients, 0.5))
            draw_objects(plan, OBJECTS, MIRROR_IMAGES)
            finish_map(plan, f"{name.capitalize()} Φ")
            draw_signal(signal, trace.sample_times_s(), one.signal, "received", FAINT)
            signal.plot(
                1e3 * trace.sample_times_s(),
                one.residual,
                color=RESIDUAL,
                linewidth=0.6,
                label="residual y − Φ q",
            )
            signal.set_ylim(-0.12, 0.12)
            annotate(
                signal,
                f"‖y − Φ q‖ = {np.linalg.norm(one.residual):.2g},"
                f" {one.relative_residual:.1g} of ‖y‖",
            )
        maps[0].legend(loc="upper left", markerscale=0.6)
        signals[0].legend(loc="upper right")
        figure.colorbar(squares[0], ax=maps, label="coefficient", shrink=0.7)
    return figure
