"""Reconstruction is indifferent to when and how loud, and its two dictionaries agree."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.trace import EchoTrace, Encoding
from usmap_ros.reconstruction.cells import cell_cone, reconstruct_cells
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation.receiver import Arrivals, Receiver

QUICK = settings(max_examples=25)
RATES_HZ = {Encoding.IQ: 25_000.0, Encoding.ENVELOPE: 25_000.0, Encoding.RAW: 250_000.0}
TRANSDUCER = Transducer(
    Pulse(PulseShape.HANN_BURST, 50_000.0, 3.2e-4), BeamPattern.linear(), 0.2, 4.0
)
seeds = st.integers(0, 2**32 - 1)
encodings = st.sampled_from(Encoding)
floors = st.sampled_from([0.0, 0.5])


def heard(ranges_m, strengths, encoding, floor_m, noise_std=0.0, seed=0):
    """Trace of objects on the axis whose direct paths have the amplitudes `strengths`."""
    channel = Channel(343.0, floor_height_m=floor_m, floor_reflectivity=0.7)
    amplitudes = channel.amplitudes(ranges_m)
    amplitudes *= (strengths / amplitudes[:, 0])[:, np.newaxis]
    receiver = Receiver(encoding, RATES_HZ[encoding], 0.0, noise_std)
    samples = receiver.receive(
        [Arrivals(TRANSDUCER.pulse, channel.delays_s(ranges_m).ravel(), amplitudes.ravel())],
        TRANSDUCER.pulse,
        receiver.sample_count(0.027),
        np.random.default_rng(seed),
    )
    return EchoTrace(
        stamp_ns=0,
        frame_id="map",
        child_frame_id="sonar",
        pose=Pose.planar(0.0, 0.025, 0.0),
        transducer=TRANSDUCER,
        channel=channel,
        encoding=encoding,
        sample_rate_hz=RATES_HZ[encoding],
        start_delay_s=0.0,
        noise_std=receiver.stated_noise_std,
        samples=samples,
    )


def scene(seed, floor_m):
    """Ranges far enough apart not to overlap, and amplitudes."""
    generator = np.random.default_rng(seed)
    slots = generator.choice(8 if floor_m == 0.0 else 3, generator.integers(1, 4), replace=False)
    spacing_m = 0.4 if floor_m == 0.0 else 1.1
    ranges_m = np.sort(0.5 + spacing_m * slots + generator.uniform(0.0, 0.2, len(slots)))
    return ranges_m, generator.uniform(0.3, 1.0, len(slots))


def strong(cone):
    """Ranges and amplitudes of all echoes but those that a little rounding brings about."""
    chosen = cone.amplitudes > 0.1 * cone.amplitudes.max()
    return cone.ranges_m[chosen], cone.amplitudes[chosen]


@QUICK
@given(seeds, encodings, floors)
def test_exact_recovery_between_the_samples(seed, encoding, floor_m):
    ranges_m, strengths = scene(seed, floor_m)
    trace = heard(ranges_m, strengths, encoding, floor_m)
    found_m, amplitudes = strong(reconstruct(trace, ReconstructionParameters()).cone)

    np.testing.assert_allclose(found_m, ranges_m, atol=1e-3)
    np.testing.assert_allclose(amplitudes, strengths, rtol=0.05)


@QUICK
@given(seeds, encodings, floors, st.sampled_from([0.25, 2.0, 1024.0]))
def test_a_louder_trace_has_the_same_echoes_only_louder(seed, encoding, floor_m, factor):
    ranges_m, strengths = scene(seed, floor_m)
    trace = heard(ranges_m, strengths, encoding, floor_m, noise_std=0.005, seed=seed)
    # A power of two leaves the digits of floats alone.
    louder = replace(
        trace, samples=trace.samples * np.float32(factor), noise_std=trace.noise_std * factor
    )
    cone = reconstruct(trace, ReconstructionParameters()).cone
    scaled = reconstruct(louder, ReconstructionParameters()).cone

    np.testing.assert_allclose(scaled.ranges_m, cone.ranges_m, rtol=1e-6)
    np.testing.assert_allclose(scaled.amplitudes, factor * cone.amplitudes, rtol=1e-4)


@QUICK
@given(seeds, st.sampled_from([Encoding.IQ, Encoding.ENVELOPE]), st.integers(0, 60))
def test_a_later_trace_has_the_same_echoes_only_farther(seed, encoding, samples):
    """Not over a floor, whose paths do not all grow by the same length."""
    ranges_m, strengths = scene(seed, 0.0)
    trace = heard(ranges_m, strengths, encoding, 0.0, noise_std=0.005, seed=seed)
    later = replace(trace, start_delay_s=trace.start_delay_s + samples / trace.sample_rate_hz)
    shift_m = 0.5 * 343.0 * samples / trace.sample_rate_hz
    cone = reconstruct(trace, ReconstructionParameters()).cone
    shifted = reconstruct(later, ReconstructionParameters()).cone

    inside = (ranges_m + shift_m < 3.9) & (ranges_m > 0.3)
    for range_m in ranges_m[inside]:
        original = cone.ranges_m[np.argmin(np.abs(cone.ranges_m - range_m))]
        moved = shifted.ranges_m[np.argmin(np.abs(shifted.ranges_m - range_m - shift_m))]
        assert moved - original == pytest.approx(shift_m, abs=2e-4)


@QUICK
@given(seeds, st.sampled_from([Encoding.IQ, Encoding.RAW]), floors)
def test_both_dictionaries_agree_on_the_grid(seed, encoding, floor_m):
    """Objects at the centres of cells, on the axis: 0.1 m cells from 0.05 m on."""
    generator = np.random.default_rng(seed)
    slots = np.sort(
        generator.choice(8 if floor_m == 0.0 else 3, generator.integers(1, 4), replace=False)
    )
    ranges_m = 0.55 + (0.4 if floor_m == 0.0 else 1.1) * slots
    strengths = generator.uniform(0.3, 1.0, len(slots))
    trace = replace(heard(ranges_m, strengths, encoding, floor_m), pose=Pose.planar(0.0, 0.05, 0.0))
    delays = strong(reconstruct(trace, ReconstructionParameters()).cone)
    parameters = ReconstructionParameters(dictionary="cells", cell_size_m=0.1)
    cells = strong(cell_cone(trace, reconstruct_cells(trace, parameters), parameters))

    np.testing.assert_allclose(delays, cells, rtol=0.02, atol=1e-3)
    np.testing.assert_allclose(cells[0], ranges_m, rtol=1e-6)
    np.testing.assert_allclose(cells[1], strengths, rtol=1e-2)
