"""Grid size against sampling rate: how many cells a trace can tell apart."""

from dataclasses import replace

import numpy as np

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.paper.drawing import COEFFICIENT
from usmap_ros.paper.figures_2_3 import in_company
from usmap_ros.paper.part import Part
from usmap_ros.paper.setting import AIR, OBLIQUE, SQUARE_PULSE, hear
from usmap_ros.plotting.style import ROBOTS, new_figure, styled
from usmap_ros.reconstruction.cell_dictionary import CellDictionary
from usmap_ros.reconstruction.matrix_operator import same_direction

CELLS_M = (0.2, 0.3, 0.5, 0.7, 1.0)
RATES_HZ = (1e3, 2e3, 5e3, 10e3, 20e3, 50e3, 100e3)
RANGE_M = 8.0


def grid_size_against_rate() -> Part:
    """Count the cells with a column unlike all others, over cell sizes and sampling rates."""
    shares = np.array([[share_told_apart(cell_m, rate) for rate in RATES_HZ] for cell_m in CELLS_M])
    with styled():
        figure = new_figure(6.4, 4.0)
        axes = figure.subplots()
        image = axes.imshow(
            100.0 * shares,
            origin="lower",
            aspect="auto",
            cmap=COEFFICIENT.reversed(),
            vmin=0.0,
            vmax=100.0,
        )
        for row, column in np.ndindex(*shares.shape):
            share = shares[row, column]
            axes.text(
                column,
                row,
                f"{100.0 * share:.0f}",
                ha="center",
                va="center",
                fontsize=8,
                color="white" if share < 0.5 else "black",
            )
        axes.set_xticks(range(len(RATES_HZ)), [f"{rate / 1e3:g}" for rate in RATES_HZ])
        axes.set_yticks(range(len(CELLS_M)), [f"{cell_m:g}" for cell_m in CELLS_M])
        axes.set(xlabel="sampling rate (kHz)", ylabel="side of a cell (m)")
        axes.set_title("Cells with a column of their own, sensor turned against the grid")
        axes.grid(visible=False)
        axes.plot(
            *_as_many_delays_as_cells(),
            color=ROBOTS[0],
            linewidth=2.0,
            label="a sample for each cell",
        )
        axes.legend(loc="lower left")
        axes.set(xlim=(-0.5, len(RATES_HZ) - 0.5), ylim=(-0.5, len(CELLS_M) - 0.5))
        figure.colorbar(image, ax=axes, label="share of the cells (%)")
    numbers = {
        "cells_m": list(CELLS_M),
        "rates_hz": list(RATES_HZ),
        "share_told_apart": shares.tolist(),
    }
    return Part("beyond_grid_size_and_rate", numbers, figure)


def share_told_apart(cell_m: float, rate_hz: float) -> float:
    """Share of the cells in the turned cone whose column is no multiple of another."""
    listening = replace(SQUARE_PULSE, sample_rate_hz=rate_hz, max_range_m=RANGE_M)
    trace = hear([], listening, pose=OBLIQUE)
    dictionary = CellDictionary.for_trace(trace, cell_m, as_sparse=True)
    labels = same_direction(dictionary, np.random.default_rng(0))
    return 1.0 - in_company(labels) / len(labels)


def _as_many_delays_as_cells() -> tuple[FloatArray, FloatArray]:
    """Where the cone has as many cells as the trace has samples, in indices of the picture."""
    cells_m = np.linspace(CELLS_M[0], CELLS_M[-1], 200)
    cells = BeamPattern.linear().half_angle_rad * (RANGE_M / cells_m) ** 2
    rates_hz = cells * AIR.sound_speed_m_s / (2.0 * RANGE_M)
    x = np.interp(np.log(rates_hz), np.log(RATES_HZ), np.arange(len(RATES_HZ)), left=np.nan)
    return x, np.interp(cells_m, CELLS_M, np.arange(len(CELLS_M)))
