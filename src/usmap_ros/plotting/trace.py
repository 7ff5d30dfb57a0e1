"""Picture of one echo trace, what reconstruction makes of it, and what is left over."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.plotting import style

if TYPE_CHECKING:
    from usmap_ros.reconstruction.explained import Reconstruction

#: Amplitudes below are drawn at the bottom of the picture.
_FLOOR_DB = -80.0


def draw_trace(upper: Axes, lower: Axes, reconstruction: Reconstruction) -> None:
    """Draw signal and reconstruction into one pair of axes, the residual into the other."""
    cone, residual = reconstruction.cone, reconstruction.residual
    received = reconstruction.received
    ranges_m = 0.5 * reconstruction.trace.channel.sound_speed_m_s * reconstruction.delays_s
    explained = received - residual

    upper.fill_between(
        ranges_m, _FLOOR_DB, _decibels(received),
        color=style.SIGNAL, alpha=0.35, linewidth=0.0, label="received",
    )  # fmt: skip
    upper.plot(ranges_m, _decibels(explained), color=style.RECONSTRUCTION, label="reconstructed")
    # Around an echo the limit is so high that it says nothing.
    limits = cone.limit_amplitudes()
    limits_db = 20.0 * np.log10(np.where(limits < 1.0, limits, np.nan))
    edges_m = cone.transducer.min_range_m + cone.limit_step_m * np.arange(len(limits_db) + 1)
    upper.stairs(
        limits_db, edges_m, color=style.LIMIT, linewidth=1.0, linestyle=(0, (4, 2)), baseline=None,
        label="detection limit",
    )  # fmt: skip
    echoes = style.counted(len(cone.ranges_m), "echo", "echoes")
    upper.plot(
        cone.ranges_m, _decibels(cone.amplitudes) + 2.5, linestyle="none", marker="v",
        markersize=5, color=style.RECONSTRUCTION, label=echoes,
    )  # fmt: skip
    upper.set_title(f"Echo trace of {reconstruction.trace.child_frame_id}")
    upper.legend(ncols=4, loc="upper right")

    lower.plot(ranges_m, _decibels(residual), color=style.RESIDUAL, linewidth=0.8, label="residual")
    if reconstruction.noise_std > 0.0:
        lower.axhline(
            20.0 * np.log10(reconstruction.noise_std), color=style.FAINT, linewidth=1.0,
            linestyle=(0, (4, 2)), label="receiver noise",
        )  # fmt: skip
    lower.legend(ncols=2, loc="upper right")
    lower.set_xlabel("range (m)")
    _share_scale(upper, lower, received, residual)
    lower.set_xlim(0.0, ranges_m[-1])


def _share_scale(upper: Axes, lower: Axes, *signals: NDArray[np.generic]) -> None:
    """Scale amplitudes so that the noise is seen, and not much below it."""
    top_db = max(float(_decibels(signal).max()) for signal in signals)
    bottom_db = max(_FLOOR_DB, 10.0 * np.floor(np.median(_decibels(signals[-1])) / 10.0) - 10.0)
    for axes in (upper, lower):
        axes.set_ylabel("amplitude (dB)")
    upper.set_ylim(bottom_db, max(top_db, bottom_db + 20.0) + 14.0)
    lower.set_ylim(bottom_db, bottom_db + 40.0)


def _decibels(signal: NDArray[np.generic]) -> FloatArray:
    """Magnitude in decibels, where 0 is the echo of an ideal point at 1 m."""
    magnitude = np.maximum(np.abs(signal), 10.0 ** (_FLOOR_DB / 20.0))
    return np.asarray(20.0 * np.log10(magnitude), dtype=np.float64)
