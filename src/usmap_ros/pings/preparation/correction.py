"""Traces set right: what a calibration found, applied before all else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from usmap_ros.acoustics.propagation import Channel, FloorModel
from usmap_ros.parameters import CorrectionParameters
from usmap_ros.pings.trace import EchoTrace

_NEUTRAL = CorrectionParameters()


def corrected(trace: EchoTrace, correction: CorrectionParameters) -> EchoTrace:
    """Give `trace` the units, the time and the channel that it should have had.

    Parameters
    ----------
    trace : EchoTrace
        As recorded; it stays as it is.
    correction : CorrectionParameters
        What is off in it.

    Returns
    -------
    EchoTrace
        Samples that would then lie before the start of emission are left out.
    """
    if correction == _NEUTRAL:
        return trace
    channel = corrected_channel(trace.channel, correction)
    start_s = trace.start_delay_s - 2.0 * correction.range_offset_m / channel.sound_speed_m_s
    early = max(0, int(np.ceil(-start_s * trace.sample_rate_hz)))
    shifted = replace(trace, start_delay_s=start_s).cut(early)
    return replace(
        shifted,
        channel=channel,
        noise_std=trace.noise_std / correction.gain,
        samples=(shifted.samples / np.float32(correction.gain)).astype(np.float32),
    )


def corrected_channel(stated: Channel, correction: CorrectionParameters) -> Channel:
    """What the sound travels through, where messages state `stated`."""
    height_m, reflectivity = correction.floor_height_m, correction.floor_reflectivity
    return replace(
        stated,
        sound_speed_m_s=correction.sound_speed_m_s or stated.sound_speed_m_s,
        floor_height_m=stated.floor_height_m if height_m < 0.0 else height_m,
        floor_reflectivity=stated.floor_reflectivity if reflectivity < 0.0 else reflectivity,
        floor_model=FloorModel(correction.floor_model),
    )
