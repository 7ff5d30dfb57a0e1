"""Values in other units than they should be: said in a line, with what they may have meant."""

from collections.abc import Iterator, Mapping

import numpy as np

from usmap_ros.importing.description import Recording
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.simulation.models.transducers import TableBeamModel

#: Whole numbers beyond this are counts of a converter.
_LEAST_COUNTS = 16.0
#: Longest burst (s), lowest carrier (Hz) and longest time between pings (s) that sensors have: none
#: pings more often than every 5 ms.
_LONGEST_BURST_S, _LOWEST_CARRIER_HZ, _LONGEST_INTERVAL_S = 0.05, 5e3, 4.9
#: Longest delay of a first sample, s.
_LONGEST_DELAY_S = 0.2
#: Fastest robot, m/s.
_FASTEST_M_S = 15.0
#: A range beyond the end of a trace by more than this factor was counted there and back.
_BEYOND = 1.5


def unit_problem(
    recording: Recording,
    largest_sample: float,
    has_whole_samples: bool,
    trace_s: float,
    rate_hz: float,
    poses: Mapping[str, FloatArray],
) -> str:
    """What looks like another unit, in one line; empty if nothing does.

    Parameters
    ----------
    recording : Recording
        What was stated.
    largest_sample : float
        Largest magnitude of a sample, as read.
    has_whole_samples : bool
        Whether all samples are whole numbers.
    trace_s, rate_hz : float
        Length of a trace, and its sample rate.
    poses : mapping
        Columns of the poses.
    """
    if recording.units_checked:
        return ""
    problems = [
        *_of_samples(recording, largest_sample, has_whole_samples, rate_hz),
        *_of_times(recording, poses["time_s"]),
        *_of_beam(recording),
        *pose_problems(poses),
        *_of_ranges(recording, trace_s),
    ]
    if not problems:
        return ""
    return f"{problems[0]}; units_checked: true says that it is meant as it stands"


def _of_samples(
    recording: Recording, largest: float, has_whole_samples: bool, rate_hz: float
) -> Iterator[str]:
    carrier_hz = recording.pulse.carrier_hz
    if recording.samples.full_scale == 0.0 and has_whole_samples and largest > _LEAST_COUNTS:
        yield (
            f"samples: are whole numbers up to {largest:g}, as a converter counts: state"
            " samples.full_scale, the count of an amplitude of 1 or, as a first guess, the"
            " largest one there is"
        )
    if carrier_hz < _LOWEST_CARRIER_HZ and recording.pulse.shape != "square":
        yield f"pulse.carrier_hz: {carrier_hz:g} Hz can be heard; kilohertz? then it is" + (
            f" {1e3 * carrier_hz:g}"
        )
    if recording.samples.encoding == "raw" and rate_hz <= 2.0 * carrier_hz:
        meant = f"; kilohertz? then it is {1e3 * rate_hz:g}" if rate_hz < 1e4 else ""
        yield (
            f"samples.sample_rate_hz: {rate_hz:g} Hz is too low for a raw carrier of"
            f" {carrier_hz:g} Hz{meant}"
        )


def _of_times(recording: Recording, time_s: FloatArray) -> Iterator[str]:
    duration_s, delay_s = recording.pulse.duration_s, recording.samples.start_delay_s
    if duration_s > _LONGEST_BURST_S:
        yield (
            f"pulse.duration_s: {duration_s:g} s is no burst; milliseconds? then it is"
            f" {1e-3 * duration_s:g}"
        )
    if delay_s > _LONGEST_DELAY_S:
        yield (
            f"samples.start_delay_s: {delay_s:g} s after the burst all is silent; milliseconds?"
            f" then it is {1e-3 * delay_s:g}"
        )
    if len(time_s) > 2:
        interval_s = float(np.median(np.diff(time_s)))
        if interval_s > _LONGEST_INTERVAL_S:
            yield (
                f"time_s: pings are {interval_s:g} s apart; milliseconds? then divide them by 1000"
            )
        if interval_s <= 0.0:
            yield "time_s: does not ascend"


def _of_beam(recording: Recording) -> Iterator[str]:
    beam = recording.beam
    if isinstance(beam, TableBeamModel) and max(beam.angles_rad) > np.pi:
        yield (
            f"beam.angles_rad: go to {max(beam.angles_rad):g} rad, behind the sensor; degrees? then"
            " multiply them by π / 180"
        )


def pose_problems(poses: Mapping[str, FloatArray]) -> Iterator[str]:
    """What looks like another unit in columns of poses."""
    widest = float(np.abs(poses["yaw_rad"]).max(initial=0.0))
    if widest > 2.0 * np.pi and float(np.abs(np.diff(poses["yaw_rad"])).max(initial=0.0)) > 0.2:
        yield (
            f"yaw_rad: goes to {widest:g} rad, more than a turn; degrees? then multiply them by"
            " π / 180"
        )
    places = np.stack([poses["x_m"], poses["y_m"]], axis=-1)
    steps_m = np.linalg.norm(np.diff(places, axis=0), axis=1)
    steps_s = np.maximum(np.diff(poses["time_s"]), 1e-6)
    if len(steps_m) and float(np.median(steps_m / steps_s)) > _FASTEST_M_S:
        yield (
            f"x_m, y_m: the robot goes at {np.median(steps_m / steps_s):.0f} m/s; millimetres?"
            " then divide them by 1000"
        )


def _of_ranges(recording: Recording, trace_s: float) -> Iterator[str]:
    speed_m_s = 331.3 + 0.6 * recording.air.temperature_c
    reach_m = 0.5 * speed_m_s * (recording.samples.start_delay_s + trace_s)
    if recording.max_range_m > _BEYOND * reach_m:
        yield (
            f"max_range_m: {recording.max_range_m:g} m cannot be heard in a trace of"
            f" {1e3 * trace_s:.3g} ms, in which sound goes {reach_m:.3g} m there and back; the"
            " whole way taken for the range?"
        )
