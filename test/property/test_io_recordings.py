"""Whatever a trace or cone holds, it survives; wherever a recording is damaged, reading does."""

import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import BagError, MalformedMessageError
from usmap_ros.io.bag_reader import BagReader
from usmap_ros.io.bag_writer import new_bag
from usmap_ros.io.conversions import cone_from_cdr, cone_to_cdr, trace_from_cdr, trace_to_cdr
from usmap_ros.io.message_types import ECHO_CONE, ECHO_TRACE, typestore
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace, Encoding

EPOCH = 1_700_000_000_000_000_000
TRACES = 60


def positive(greatest: float) -> st.SearchStrategy[float]:
    return st.floats(1e-3, greatest)


def float32s(size: int, least: float = -1e3) -> st.SearchStrategy[np.ndarray]:
    return arrays(np.float32, size, elements=st.floats(least, 1e3, width=32))


names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=20)
stamps = st.integers(0, (2**31 - 1) * 1_000_000_000)


@st.composite
def poses(draw: st.DrawFn) -> Pose:
    x, y, yaw, z = (draw(st.floats(-1e3, 1e3)) for _ in range(4))
    return Pose.planar(x, y, yaw, z, np.diag([draw(st.floats(0, 10)) for _ in range(3)]))


@st.composite
def transducers(draw: st.DrawFn) -> Transducer:
    shape = draw(st.sampled_from(PulseShape))
    carrier_hz = 0.0 if shape is PulseShape.SQUARE else draw(st.floats(1e3, 1e6))
    steps = draw(st.lists(st.floats(0.01, 0.1), min_size=1, max_size=20))
    angles = np.concatenate([[0.0], np.cumsum(steps)])
    gains = np.concatenate([[1.0], draw(arrays(np.float64, len(steps), elements=st.floats(0, 1)))])
    least_m = draw(st.floats(0.0, 10.0))
    return Transducer(
        Pulse(shape, carrier_hz, draw(st.floats(1e-4, 1e-2))),
        BeamPattern(angles, gains),
        least_m,
        least_m + draw(positive(100.0)),
    )


@st.composite
def traces(draw: st.DrawFn) -> EchoTrace:
    return EchoTrace(
        stamp_ns=draw(stamps),
        frame_id=draw(names),
        child_frame_id=draw(names),
        pose=draw(poses()),
        transducer=draw(transducers()),
        channel=Channel(
            draw(st.floats(1.0, 5e3)),
            draw(st.floats(0, 2)),
            draw(st.floats(0, 5)),
            draw(st.floats(0, 1)),
        ),
        encoding=draw(st.sampled_from(Encoding)),
        # With the longest pulse as many samples as a raw one may have.
        sample_rate_hz=draw(st.floats(2e4, 5e5)),
        start_delay_s=draw(st.floats(0, 1)),
        noise_std=draw(st.floats(0, 10)),
        samples=draw(float32s(2 * draw(st.integers(1, 50)))),
    )


@st.composite
def cones(draw: st.DrawFn) -> EchoCone:
    echoes = draw(st.integers(0, 20))
    columns = [draw(float32s(echoes, least=0.0)) for _ in range(4)]
    columns[0].sort()  # Echoes are listed by range.
    return EchoCone(
        draw(stamps), draw(names), draw(names), draw(poses()), draw(transducers()),
        draw(st.floats(0, 2)), *columns,
        limit_step_m=draw(st.sampled_from([0.5, 0.125, 0.03125])),
        detection_limits=draw(arrays(np.uint8, draw(st.integers(1, 50)))),
        residual=draw(st.floats(0, 2, width=32)),
    )  # fmt: skip


def by_rosbags(payload: bytes, message_type: str, *, is_little: bool) -> bytes:
    """Give the same message as another library writes it that knows its definition alone."""
    message = typestore().deserialize_cdr(payload, message_type)
    return bytes(typestore().serialize_cdr(message, message_type, little_endian=is_little))


@given(traces(), st.booleans())
def test_a_trace_survives_recording(trace: EchoTrace, is_little: bool) -> None:
    written = trace_to_cdr(trace)
    assert by_rosbags(written, ECHO_TRACE, is_little=True) == written
    found = trace_from_cdr(by_rosbags(written, ECHO_TRACE, is_little=is_little))
    np.testing.assert_array_equal(found.samples, trace.samples)
    np.testing.assert_array_equal(found.pose.position_m, trace.pose.position_m)
    np.testing.assert_array_equal(found.pose.covariance, trace.pose.covariance)
    np.testing.assert_array_equal(found.pose.orientation, trace.pose.orientation)
    np.testing.assert_array_equal(
        found.transducer.beam.angles_rad, trace.transducer.beam.angles_rad
    )
    np.testing.assert_array_equal(found.transducer.beam.gains, trace.transducer.beam.gains)
    assert found.transducer.pulse == trace.transducer.pulse
    assert found.transducer.max_range_m == trace.transducer.max_range_m
    assert found.channel == trace.channel
    assert (found.stamp_ns, found.frame_id, found.child_frame_id, found.encoding) == (
        trace.stamp_ns, trace.frame_id, trace.child_frame_id, trace.encoding,
    )  # fmt: skip
    assert (found.sample_rate_hz, found.start_delay_s, found.noise_std) == (
        trace.sample_rate_hz, trace.start_delay_s, trace.noise_std,
    )  # fmt: skip


@given(cones(), st.booleans())
def test_a_cone_survives_recording(cone: EchoCone, is_little: bool) -> None:
    written = cone_to_cdr(cone)
    assert by_rosbags(written, ECHO_CONE, is_little=True) == written
    found = cone_from_cdr(by_rosbags(written, ECHO_CONE, is_little=is_little))
    for name in ("ranges_m", "range_stds_m", "amplitudes", "amplitude_stds", "detection_limits"):
        np.testing.assert_array_equal(getattr(found, name), getattr(cone, name))
    assert (found.limit_step_m, found.residual) == (cone.limit_step_m, cone.residual)
    assert (found.stamp_ns, found.frame_id, found.child_frame_id, found.attenuation_db_m) == (
        cone.stamp_ns, cone.frame_id, cone.child_frame_id, cone.attenuation_db_m,
    )  # fmt: skip


@given(traces(), st.floats(0, 1, exclude_max=True))
def test_a_message_that_ends_early_is_refused(trace: EchoTrace, share: float) -> None:
    written = trace_to_cdr(trace)
    with pytest.raises(MalformedMessageError):
        trace_from_cdr(written[: int(share * len(written))])


@given(cones(), st.data())
def test_a_wrong_byte_breaks_nothing(cone: EchoCone, data: st.DataObject) -> None:
    """What is read of it may be true, too; anything else but a refusal would be a mistake."""
    payload = bytearray(cone_to_cdr(cone))
    payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    with suppress(MalformedMessageError):
        cone_from_cdr(bytes(payload))


def recorded_trace(number: int) -> EchoTrace:
    return EchoTrace(
        EPOCH + number * 100_000_000, "map", "sonar", Pose.planar(0.0, 0.0, 0.0),
        Transducer(
            Pulse(PulseShape.HANN_BURST, 5e4, 3e-4),
            BeamPattern(np.array([0.0, 0.7]), np.array([1.0, 0.0])), 0.2, 5.0,
        ),
        Channel(343.0), Encoding.IQ, 25e3, 0.0, 0.01,
        np.random.default_rng(number).standard_normal(1500).astype(np.float32),
    )  # fmt: skip


@pytest.fixture(scope="module", params=["none", "lz4", "zstd"])
def recording(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Give the bytes of a recording of a few chunks."""
    folder = tmp_path_factory.mktemp("recording") / "bag"
    with new_bag(folder, compression=request.param) as writer:
        for number in range(TRACES):
            writer.write_trace("/echo", recorded_trace(number))
    return (folder / "bag.mcap").read_bytes()


@pytest.fixture
def damaged_file() -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        yield Path(folder) / "damaged.mcap"


def numbers_in(file: Path) -> list[int]:
    """Numbers of the traces that can be read, or none if the file is refused."""
    try:
        with BagReader([file]) as bag:
            return [(trace.stamp_ns - EPOCH) // 100_000_000 for _, trace in bag.traces()]
    except BagError:
        return []


damages = settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])


@damages
@given(share=st.floats(0, 1))
def test_a_cut_recording_is_read_up_to_the_cut(
    recording: bytes, damaged_file: Path, share: float
) -> None:
    size = int(share * len(recording))
    damaged_file.write_bytes(recording[:size])
    kept = numbers_in(damaged_file)
    assert kept == list(range(len(kept)))


@damages
@given(share=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_is_never_taken_for_data(
    recording: bytes, damaged_file: Path, share: float, bit: int
) -> None:
    content = bytearray(recording)
    content[int(share * len(content))] ^= 1 << bit
    damaged_file.write_bytes(content)
    kept = numbers_in(damaged_file)
    assert kept == list(range(len(kept)))


@damages
@given(st.binary(max_size=200))
def test_anything_may_follow_the_magic(damaged_file: Path, content: bytes) -> None:
    damaged_file.write_bytes(b"\x89MCAP0\r\n" + content)
    assert numbers_in(damaged_file) == []
