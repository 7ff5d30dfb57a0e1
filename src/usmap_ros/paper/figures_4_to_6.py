"""Figures 4 to 6: three objects, what is received and made of it, and one object's four paths."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usmap_ros.paper.drawing import (
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
    SQUARE_PULSE,
    coefficients_by_cell,
    f1_of_sets,
    hear,
    method,
    sets_of,
    weights_at,
)
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.plotting.style import FAINT, INK, RECONSTRUCTION, ROBOTS, TRUTH, new_figure, styled
from usmap_ros.reconstruction.cells import CellReconstruction, reconstruct_cells

#: Range of the object in the schematic.
RANGE_M = 4.0
#: Legs out and back: straight, or by way of the floor.
PATHS = {
    "1  direct": ("direct", "direct"),
    "2  floor first, then object": ("floor", "direct"),
    "3  object first, then floor": ("direct", "floor"),
    "4  floor, object, floor": ("floor", "floor"),
}


def scene_and_pulse_train() -> Part:
    """Draw figure 4: where the objects stand, and what is received."""
    trace = hear(OBJECTS, SQUARE_PULSE)
    with styled():
        figure = new_figure(9.0, 3.8)
        scene, signal = figure.subplots(1, 2, width_ratios=[1.0, 1.4])
        draw_cone_edge(scene, ALIGNED)
        draw_objects(scene, OBJECTS)
        finish_map(scene, "Three objects in the cone")
        scene.set_xticks(np.arange(-6, 8), minor=True)
        scene.set_yticks(np.arange(0, 11), minor=True)
        scene.grid(visible=True, which="both")
        scene.legend(loc="lower left", markerscale=0.6)
        draw_signal(signal, trace.sample_times_s(), trace.signal(), "received")
        signal.set_yscale("log")
        signal.set_ylim(1e-3, 1.0)
        signal.set_title("The pulse train that comes back")
        _name_echoes(signal, trace)
        signal.legend(loc="upper right")
    amplitudes = _amplitudes(trace)
    numbers = {
        "objects_m": [list(point) for point in OBJECTS],
        "delays_ms": [1e3 * delay for delay in _delays_s(trace)],
        "amplitudes": amplitudes,
        "caption": {
            "three pulses of different delay and amplitude": statement(
                len(set(np.round(amplitudes, 6))) == 3 and _pulses(trace) == 3,
                pulses=_pulses(trace),
            )
        },
    }
    return Part("figure_4_scene_and_pulse_train", numbers, figure)


def reconstruction() -> Part:
    """Draw figure 5: coefficients by cell, and the residual."""
    trace = hear(OBJECTS, SQUARE_PULSE)
    found = reconstruct_cells(trace, method())
    numbers = {
        "coefficients": coefficients_by_cell(found),
        "mirror_images_m": [list(point) for point in MIRROR_IMAGES],
        "relative_residual": found.relative_residual,
        "halt": found.solution.halt.name,
        "iterations": found.solution.iterations,
        "f1": f1_of_sets(found, OBJECTS),
        "caption": _caption(found),
    }
    return Part("figure_5_reconstruction", numbers, _reconstruction_figure(trace, found))


def _caption(found: CellReconstruction) -> dict[str, object]:
    cells = [np.bincount(found.sets)[sets_of(found, [point])].item() for point in OBJECTS]
    weights = weights_at(found, OBJECTS)
    elsewhere = float(found.coefficients.sum() - weights.sum())
    return {
        "every object is found": statement(
            (weights >= FOUND_WEIGHT).all(), weights=weights.tolist()
        ),
        "the two closer objects have a mirror image, the far one has none": statement(
            cells == [2, 2, 1], cells=cells
        ),
        "nothing else is found": statement(abs(elsewhere) < 1e-3, weight_elsewhere=elsewhere),
    }


def _reconstruction_figure(trace: EchoTrace, found: CellReconstruction) -> Figure:
    with styled():
        figure = new_figure(9.0, 4.2)
        plan, signal = figure.subplots(1, 2, width_ratios=[1.15, 1.3])
        draw_cone_edge(plan, ALIGNED)
        squares = draw_cells(plan, found.dictionary.cells, found.coefficients)
        draw_objects(plan, OBJECTS, MIRROR_IMAGES)
        finish_map(plan, "Coefficients of the cells")
        share_legend(figure, plan)
        figure.colorbar(squares, ax=plan, label="coefficient", shrink=0.8)
        times_s = trace.sample_times_s()
        draw_signal(signal, times_s, found.signal, "received")
        explained = found.signal - found.residual
        signal.plot(
            1e3 * times_s, explained, "--", color=RECONSTRUCTION, linewidth=1.0, label="Φ q"
        )
        signal.set_title("Signal, and what the coefficients explain of it")
        signal.legend()
    return figure


def _pulses(trace: EchoTrace) -> int:
    """Pulses that are apart from each other."""
    sounding = np.abs(trace.signal()) > 0.0
    return int(np.count_nonzero(np.diff(sounding.astype(int), prepend=0) == 1))


def _delays_s(trace: EchoTrace) -> list[float]:
    ranges_m, _ = trace.pose.polar(np.asarray(OBJECTS))
    return [float(delay) for delay in 2.0 * ranges_m / trace.channel.sound_speed_m_s]


def _amplitudes(trace: EchoTrace) -> list[float]:
    """Of the received pulses, read half a pulse after each delay."""
    middle_s = np.array(_delays_s(trace)) + 0.5 * trace.transducer.pulse.duration_s
    index = np.rint(middle_s * trace.sample_rate_hz).astype(int)
    return [float(value) for value in trace.signal()[index]]


def _name_echoes(axes: Axes, trace: EchoTrace) -> None:
    for name, delay_s, amplitude in zip(NAMES, _delays_s(trace), _amplitudes(trace), strict=True):
        axes.annotate(
            name,
            (1e3 * delay_s + 0.5, amplitude),
            (0, 6),
            textcoords="offset points",
            ha="center",
            fontsize=8,
        )


def four_paths() -> Part:
    """Draw the paths from the side, and compare their lengths with those that Φ is made of."""
    height_m = CONCRETE.floor_height_m
    legs_m = {"direct": RANGE_M, "floor": 2.0 * float(np.hypot(0.5 * RANGE_M, height_m))}
    lengths_m = [legs_m[out] + legs_m[back] for out, back in PATHS.values()]
    modelled_m = CONCRETE.delays_s(np.array(RANGE_M)) * CONCRETE.sound_speed_m_s
    with styled():
        figure = new_figure(9.0, 4.4)
        panels = figure.subplots(2, 2, sharex=True, sharey=True).reshape(-1)
        for axes, (name, legs), length_m in zip(panels, PATHS.items(), lengths_m, strict=True):
            _draw_scene(axes, height_m)
            # Where both touch the floor, the way out is drawn a little above it.
            lift_m = 0.1 if legs == ("floor", "floor") else 0.0
            _draw_leg(axes, legs[0], (height_m + 0.05, lift_m), ROBOTS[0], out=True)
            _draw_leg(axes, legs[1], (height_m - 0.05, 0.0), ROBOTS[1], out=False)
            axes.set_title(f"{name}: {length_m:.2f} m")
    numbers = {
        "lengths_m": dict(zip(PATHS, lengths_m, strict=True)),
        "caption": {
            "four paths, each of which the model has": statement(
                np.allclose(sorted(set(np.round(lengths_m, 9))), modelled_m),
                model_m=modelled_m.tolist(),
            ),
            "paths 2 and 3 have one length": statement(lengths_m[1] == lengths_m[2]),
        },
    }
    return Part("figure_6_four_paths", numbers, figure)


def _draw_scene(axes: Axes, height_m: float) -> None:
    axes.axhspan(-0.25, 0.0, color="#e3e8ec", zorder=0)
    axes.axhline(0.0, color=FAINT, linewidth=1.5)
    axes.plot(0.0, height_m, marker=(3, 0, -90), color=INK, markersize=13, zorder=5)
    axes.plot(RANGE_M, height_m, "o", color=TRUTH, markersize=10, zorder=5)
    axes.text(0.0, height_m + 0.2, "transducer", ha="center", fontsize=8)
    axes.text(RANGE_M, height_m + 0.2, "object", ha="center", fontsize=8)
    axes.text(0.02, -0.08, "floor", va="center", fontsize=8, color=INK)
    axes.set(xlim=(-0.6, RANGE_M + 0.6), ylim=(-0.25, height_m + 0.5))
    axes.set_axis_off()


def _draw_leg(
    axes: Axes, leg: str, heights_m: tuple[float, float], color: str, *, out: bool
) -> None:
    """Draw one leg with arrows along it; `heights_m` are those of its ends and of the floor."""
    x, y = [0.15, RANGE_M - 0.15], [heights_m[0]] * 2
    if leg == "floor":
        x, y = [x[0], 0.5 * RANGE_M, x[1]], [y[0], heights_m[1], y[1]]
    if not out:
        x, y = x[::-1], y[::-1]
    axes.plot(x, y, color=color, linewidth=1.8)
    for start in range(len(x) - 1):
        (x0, x1), (y0, y1) = x[start : start + 2], y[start : start + 2]
        axes.annotate(
            "",
            (0.48 * x0 + 0.52 * x1, 0.48 * y0 + 0.52 * y1),
            (0.5 * (x0 + x1), 0.5 * (y0 + y1)),
            arrowprops={"arrowstyle": "-|>", "color": color, "lw": 1.8},
        )
