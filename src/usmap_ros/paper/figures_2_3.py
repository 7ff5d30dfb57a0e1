"""Figure 2: beam patterns.  Figure 3: the sensing matrix."""

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.paper.part import Part
from usmap_ros.paper.setting import ALIGNED, CELL_M, OBLIQUE, SQUARE_PULSE, hear
from usmap_ros.plotting.style import INK, RECONSTRUCTION, ROBOTS, SIGNAL, new_figure, styled
from usmap_ros.reconstruction.cell_dictionary import CellDictionary
from usmap_ros.reconstruction.matrix_operator import identical, same_direction

#: What is small is drawn as if it were this, so that a logarithm can show it.
SMALLEST = 1e-5
#: Columns and delays (ms) of the inset.
INSET_COLUMNS, INSET_MS = (46, 64), (45.0, 55.5)


def beam_patterns() -> Part:
    """Draw the linear pattern and the one of a real transducer."""
    patterns = {"linear": BeamPattern.linear(), "SensComp 600": BeamPattern.senscomp_600()}
    degrees = np.linspace(-45.0, 45.0, 361)
    with styled():
        figure = new_figure(8.0, 3.4)
        left = figure.add_subplot(1, 2, 1)
        right = figure.add_subplot(1, 2, 2, projection="polar")
        for (name, beam), color in zip(patterns.items(), ROBOTS, strict=False):
            gain = beam.gain(np.deg2rad(degrees))
            left.plot(degrees, gain, color=color, label=name)
            decibels = 20.0 * np.log10(np.maximum(gain, 1e-2))
            right.plot(np.deg2rad(degrees), decibels, color=color, label=name)
        left.set(xlabel="angle off axis (°)", ylabel="two-way amplitude gain", title="Amplitude")
        left.set_xlim(-45.0, 45.0)
        left.legend()
        _polar_axes(right)
    half_gain = {name: _half_gain_deg(beam) for name, beam in patterns.items()}
    numbers = {
        "half_angle_deg": {
            name: float(np.rad2deg(beam.half_angle_rad)) for name, beam in patterns.items()
        },
        "half_gain_deg": half_gain,
        "angles_deg": [0.0, 5.0, 10.0, 20.0, 30.0, 40.0],
        "gains": {
            name: beam.gain(np.deg2rad([0.0, 5.0, 10.0, 20.0, 30.0, 40.0])).tolist()
            for name, beam in patterns.items()
        },
    }
    return Part("figure_2_beam_patterns", numbers, figure)


def sensing_matrix() -> Part:
    """Draw Φ of the aligned cone, and count the columns that are alike."""
    trace = hear([], SQUARE_PULSE)
    dictionary = CellDictionary.for_trace(trace, CELL_M)
    delays_ms = 1e3 * trace.sample_times_s()
    magnitude = np.maximum(dictionary.matrix, SMALLEST)
    with styled():
        figure = new_figure(8.0, 4.6)
        axes = figure.subplots()
        columns: FloatArray = np.arange(dictionary.block_count + 1.0) + 0.5
        norm = LogNorm(SMALLEST, magnitude.max())
        edges_ms: FloatArray = np.append(delays_ms, 2.0 * delays_ms[-1] - delays_ms[-2])
        mesh = axes.pcolormesh(columns, edges_ms, magnitude, norm=norm, cmap="magma_r")
        axes.invert_yaxis()
        axes.set(xlabel="cell, by ascending range", ylabel="delay (ms)")
        axes.set_title("Sensing matrix Φ of the aligned cone: one column per cell of 1 m")
        axes.grid(visible=False)
        figure.colorbar(mesh, ax=axes, label="amplitude (logarithmic)", extend="min")
        _inset(axes, columns, edges_ms, magnitude, norm)
    numbers = {
        "samples": dictionary.sample_count,
        "cells": dictionary.block_count,
        "non_zero_share": float(np.count_nonzero(dictionary.matrix) / dictionary.matrix.size),
        "aligned": columns_alike(ALIGNED),
        "oblique": columns_alike(OBLIQUE),
    }
    return Part("figure_3_sensing_matrix", numbers, figure)


def columns_alike(pose: Pose) -> dict[str, int]:
    """Count the columns that have an equal one, or one that is a multiple."""
    trace = replace(hear([], SQUARE_PULSE), pose=pose)
    dictionary = CellDictionary.for_trace(trace, CELL_M)
    generator = np.random.default_rng(0)
    return {
        "cells": dictionary.block_count,
        "identical": in_company(identical(dictionary, generator)),
        "multiples": in_company(same_direction(dictionary, generator)),
    }


def in_company(labels: IndexArray) -> int:
    """How many share their label with another."""
    return int(np.count_nonzero(np.bincount(labels)[labels] > 1))


def _half_gain_deg(beam: BeamPattern) -> float:
    angles = np.linspace(0.0, 40.0, 4001)
    return float(angles[np.argmax(beam.gain(np.deg2rad(angles)) < 0.5)])


def _polar_axes(axes: Axes) -> None:
    # matplotlib's types know nothing of what polar axes have beyond others.
    polar: object = axes
    for name, value in (
        ("set_theta_zero_location", "N"),
        ("set_thetamin", -45.0),
        ("set_thetamax", 45.0),
        ("set_rmin", -40.0),
        ("set_rmax", 0.0),
    ):
        getattr(polar, name)(value)
    axes.set_yticks([-40.0, -20.0, 0.0])
    axes.set_title("Level (dB)")
    axes.legend(loc="lower right", bbox_to_anchor=(1.1, -0.1))


def _inset(
    axes: Axes, columns: FloatArray, edges_ms: FloatArray, magnitude: FloatArray, norm: LogNorm
) -> None:
    """Enlarge a part of the matrix: steps of delay, and pairs of equal columns."""
    inset = axes.inset_axes((0.5, 0.5, 0.47, 0.47))
    inset.pcolormesh(columns, edges_ms, magnitude, norm=norm, cmap="magma_r")
    inset.set_xlim(INSET_COLUMNS[0] + 0.5, INSET_COLUMNS[1] + 0.5)
    inset.set_ylim(INSET_MS[1], INSET_MS[0])
    inset.tick_params(labelsize=7)
    inset.text(
        0.03,
        0.05,
        "steps of delay; mirrored cells\nhave the same column twice",
        transform=inset.transAxes,
        fontsize=8,
        color=INK,
    )
    inset.set_xticks(np.arange(INSET_COLUMNS[0] + 2, INSET_COLUMNS[1] + 1, 4))
    inset.grid(visible=False)
    for spine in inset.spines.values():
        spine.set(visible=True, color=RECONSTRUCTION)
    axes.indicate_inset_zoom(inset, edgecolor=SIGNAL)
