"""Figure 7: sinusoids and the floor.  Figure 8: a sensing matrix with and without its paths."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.paper.drawing import (
    annotate,
    draw_cells,
    draw_cone_edge,
    draw_objects,
    draw_signal,
    finish_map,
    share_legend,
)
from usmap_ros.paper.part import Part, statement
from usmap_ros.paper.setting import (
    ALIGNED,
    CONCRETE,
    FOUND_WEIGHT,
    MIRROR_IMAGES,
    NAMES,
    OBJECTS,
    SINE,
    SINUSOID,
    SPARSITY,
    Points,
    coefficients_by_cell,
    f1_of_sets,
    hear,
    method,
    sets_of,
    spent,
    weights_at,
)
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.plotting.style import FAINT, RESIDUAL, ROBOTS, new_figure, styled
from usmap_ros.reconstruction.cells import CellReconstruction, reconstruct_cells

#: Cells that do not hold an object and still get this much of one are spurious; "many" are these.
SPURIOUS_WEIGHT, MANY = 0.1, 3


def interference() -> Part:
    """Draw figure 7: what is received without and with the floor."""
    traces = {"without a floor": hear(OBJECTS, SINUSOID), "with a floor 1 m below": _over_floor()}
    loudest = max(float(np.abs(trace.signal()).max()) for trace in traces.values())
    with styled():
        figure = new_figure(9.0, 4.6)
        panels = figure.subplots(2, 1, sharex=True, sharey=True)
        for axes, (name, trace) in zip(panels, traces.items(), strict=True):
            draw_signal(axes, trace.sample_times_s(), trace.signal(), "received")
            _mark_paths(axes, trace)
            axes.set_title(f"Sinusoids of {SINE.carrier_hz:g} Hz {name}")
            axes.set_ylim(-1.15 * loudest, 1.15 * loudest)
            axes.legend(loc="upper right")
        panels[0].set_xlabel("")
    delays_s, amplitudes = CONCRETE.delays_s(_ranges_m()), CONCRETE.amplitudes(_ranges_m())
    energy = {name: float(np.sum(trace.signal() ** 2)) for name, trace in traces.items()}
    numbers = {
        "relative_energy_of_the_floor": energy["with a floor 1 m below"] / energy["without a floor"]
        - 1.0,
        "path_delays_ms": (1e3 * delays_s).tolist(),
        "path_amplitudes": amplitudes.tolist(),
        "caption": _interference_caption(traces["with a floor 1 m below"], delays_s),
    }
    return Part("figure_7_floor_interference", numbers, figure)


def _interference_caption(trace: EchoTrace, delays_s: FloatArray) -> dict[str, Any]:
    later_s = delays_s - delays_s[:, :1]
    left = in_phase(CONCRETE, _ranges_m(), SINE.carrier_hz)
    begin, middle, end = _peaks(trace, delays_s[-1])
    return {
        "the paths of one object overlap": statement(
            (later_s < SINE.duration_s).all(), latest_ms=(1e3 * later_s[:, -1]).tolist()
        ),
        "the near and the far object interfere destructively, the middle one does not": statement(
            interfere_as_described(left), in_phase=dict(zip(NAMES, left.tolist(), strict=True))
        ),
        "the far pulse has two large spikes but a small amplitude between them": statement(
            min(begin, end) > 1.5 * middle, peaks=[begin, middle, end]
        ),
    }


def _peaks(trace: EchoTrace, delays_s: FloatArray) -> list[float]:
    """Largest amplitude of one echo before all of its paths overlap, while they do, and after."""
    first_s, last_s = delays_s[0], delays_s[-1]
    bounds_s = [first_s, last_s, first_s + SINE.duration_s, last_s + SINE.duration_s]
    samples = np.searchsorted(trace.sample_times_s(), bounds_s)
    return [float(np.abs(part).max()) for part in np.split(trace.signal(), samples)[1:-1]]


def in_phase(channel: Channel, ranges_m: FloatArray, carrier_hz: float) -> FloatArray:
    """What is left of an echo where all its paths overlap.

    Relative to the direct path and in phase with it: that is what a column of the single-path Φ
    can explain.
    """
    delays_s, amplitudes = channel.delays_s(ranges_m), channel.amplitudes(ranges_m)
    later_s = delays_s - delays_s[:, :1]
    phasors = amplitudes / amplitudes[:, :1] * np.exp(-2j * np.pi * carrier_hz * later_s)
    return np.asarray(phasors.sum(axis=1).real)


def interfere_as_described(left: FloatArray) -> bool:
    """Whether "strong destructive interference" is in the near and far pulses, but the middle's."""
    near, middle, far = left
    return bool(max(near, far) < FOUND_WEIGHT < middle)


def two_matrices() -> Part:
    """Draw figure 8: maps and residuals with the simple Φ and with the one of all paths."""
    trace = _over_floor()
    found = {
        "simple": reconstruct_cells(trace, method(), floor=False),
        "multipath": reconstruct_cells(trace, method()),
    }
    numbers: dict[str, Any] = {name: _numbers(one) for name, one in found.items()}
    numbers["objects_m"] = [list(point) for point in OBJECTS]
    numbers["caption"] = caption(found["simple"], found["multipath"], OBJECTS)
    return Part("figure_8_simple_and_multipath", numbers, _comparison(trace, found))


def caption(
    simple: CellReconstruction, multipath: CellReconstruction, objects: Points | FloatArray
) -> dict[str, Any]:
    """Judge what the caption of figure 8 says.

    Parameters
    ----------
    simple, multipath : CellReconstruction
        With a Φ of direct paths, and of all paths.
    objects : (3, 2) array-like
        The near, the middle and the far object.
    """
    near, _, far = weights_at(simple, objects)
    weights = weights_at(multipath, objects)
    strays = {
        name: _weights_elsewhere(one, objects)
        for name, one in (("simple", simple), ("multipath", multipath))
    }
    errors = simple.relative_residual, multipath.relative_residual
    return {
        "every reconstruction spends all coefficients": statement(
            spent(simple) == spent(multipath) == SPARSITY,
            simple=spent(simple),
            multipath=spent(multipath),
        ),
        "the simple Φ misses the near object": statement(near < FOUND_WEIGHT, weight=float(near)),
        "the simple Φ misses the far object": statement(far < FOUND_WEIGHT, weight=float(far)),
        "the simple Φ puts many objects where none is": statement(
            np.count_nonzero(strays["simple"] >= SPURIOUS_WEIGHT) >= MANY,
            sets_of_cells=int(np.count_nonzero(strays["simple"] >= SPURIOUS_WEIGHT)),
        ),
        "the multipath Φ finds all objects, up to symmetry": statement(
            (weights >= FOUND_WEIGHT).all(), weights=weights.tolist()
        ),
        "the multipath Φ puts none elsewhere": statement(
            strays["multipath"].max() < FOUND_WEIGHT,
            largest_weight=float(strays["multipath"].max()),
        ),
        "the error is not zero, and smaller with the multipath Φ": statement(
            1e-4 < errors[1] < errors[0], simple=errors[0], multipath=errors[1]
        ),
    }


def _weights_elsewhere(found: CellReconstruction, objects: Points | FloatArray) -> FloatArray:
    """Coefficients of the sets of mirror images in which no object is."""
    weights = np.bincount(found.sets, found.coefficients)
    return np.asarray(np.delete(weights, sets_of(found, objects)))


def _over_floor() -> EchoTrace:
    return hear(OBJECTS, SINUSOID, channel=CONCRETE)


def _ranges_m() -> FloatArray:
    ranges_m, _ = ALIGNED.polar(np.asarray(OBJECTS))
    return ranges_m


def _numbers(found: CellReconstruction) -> dict[str, object]:
    return {
        "relative_residual": found.relative_residual,
        "residual_norm": float(np.linalg.norm(found.residual)),
        "f1": f1_of_sets(found, OBJECTS),
        "weights": dict(zip(NAMES, weights_at(found, OBJECTS).tolist(), strict=True)),
        "coefficients": coefficients_by_cell(found, least=0.0),
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
    times_s = trace.sample_times_s()
    with styled():
        figure = new_figure(11.0, 6.4)
        maps, signals = figure.subplots(2, 3, height_ratios=[1.9, 1.0], sharex="row", sharey="row")
        cells = found["simple"].dictionary.cells
        draw_cells(maps[0], cells, np.zeros(len(cells)))
        draw_objects(maps[0], OBJECTS)
        draw_signal(signals[0], times_s, trace.signal(), "received")
        signals[0].set_title("(d) Received signal y")
        squares = []
        for letter, column, (name, one) in zip(["be", "cf"], (1, 2), found.items(), strict=True):
            squares.append(draw_cells(maps[column], cells, one.coefficients))
            draw_objects(maps[column], OBJECTS, MIRROR_IMAGES)
            finish_map(maps[column], f"({letter[0]}) Coefficients, {name} Φ")
            draw_signal(signals[column], times_s, one.signal, "received", FAINT)
            signals[column].plot(
                1e3 * times_s, one.residual, color=RESIDUAL, linewidth=0.9, label="y − Φ q"
            )
            signals[column].set_title(f"({letter[1]}) Error, {name} Φ")
            signals[column].set_ylabel("")
            annotate(signals[column], f"{one.relative_residual:.2f} of ‖y‖; {spent(one)} cells")
        for plan in maps:
            draw_cone_edge(plan, ALIGNED)
        finish_map(maps[0], "(a) Ground truth")
        share_legend(figure, maps[1])
        signals[1].legend(loc="lower right")
        figure.colorbar(squares[0], ax=maps, label="coefficient, at most 1 shown", shrink=0.8)
    return figure
