import struct
from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.conversions import (
    array_from_cdr,
    array_to_cdr,
    cone_from_cdr,
    cone_to_cdr,
    noise_from_cdr,
    trace_from_cdr,
    trace_to_cdr,
)
from usmap_ros.io.message_types import ECHO_TRACE, TRANSDUCER_ARRAY, typestore
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.pings.transducer_array import TransducerArray

MakeTrace = Callable[..., EchoTrace]


def changed(payload: bytes, **changes: Any) -> bytes:
    """Give a trace with some fields changed to what no `EchoTrace` can hold."""
    message = typestore().deserialize_cdr(payload, ECHO_TRACE)
    for path, value in changes.items():
        *parents, last = path.split("__")
        owner = message
        for parent in parents:
            owner = getattr(owner, parent)
        setattr(owner, last, value)
    return bytes(typestore().serialize_cdr(message, ECHO_TRACE))


def assert_same(one: Any, other: Any) -> None:
    for field in fields(one):
        left, right = getattr(one, field.name), getattr(other, field.name)
        if isinstance(left, np.ndarray):
            np.testing.assert_array_equal(left, right)
            assert left.dtype == right.dtype
        elif hasattr(left, "__dataclass_fields__"):
            assert_same(left, right)
        elif field.name == "elements":
            assert len(left) == len(right)
            for element, counterpart in zip(left, right, strict=True):
                assert_same(element, counterpart)
        else:
            assert left == right


def test_bearings_survive_the_round_trip(cone: EchoCone) -> None:
    bearings = np.array([-0.2, np.nan], dtype=np.float32)
    told = replace(cone, bearings_rad=bearings, bearing_stds_rad=np.abs(0.1 * bearings))
    assert_same(cone_from_cdr(cone_to_cdr(told)), told)


def test_an_array_survives_the_round_trip(array: TransducerArray) -> None:
    assert_same(array_from_cdr(array_to_cdr(array)), array)


@pytest.mark.parametrize("is_little", [True, False])
def test_an_array_is_what_its_definition_says(array: TransducerArray, is_little: bool) -> None:
    message = typestore().deserialize_cdr(array_to_cdr(array), TRANSDUCER_ARRAY)
    written = typestore().serialize_cdr(message, TRANSDUCER_ARRAY, little_endian=is_little)
    assert_same(array_from_cdr(written), array)


def test_an_impossible_array_is_refused(array: TransducerArray) -> None:
    written = array_to_cdr(replace(array, elements=array.elements[:1] * 2))
    with pytest.raises(MalformedMessageError, match=r"TransducerArray\.elements\.child_frame_id"):
        array_from_cdr(written)


def test_samples_are_not_copied(make_trace: MakeTrace) -> None:
    written = trace_to_cdr(make_trace())
    samples = trace_from_cdr(written).samples
    assert np.shares_memory(samples, np.frombuffer(written, np.uint8))


def test_the_noise_is_read_without_the_rest(make_trace: MakeTrace) -> None:
    assert noise_from_cdr(trace_to_cdr(make_trace(noise_std=0.25))) == 0.25
    with pytest.raises(MalformedMessageError, match="message"):
        noise_from_cdr(trace_to_cdr(make_trace())[:300])


@pytest.mark.parametrize("unknown", [-np.eye(6)[:1], 1e6 * np.eye(6)], ids=["-1", "1e6"])
def test_a_covariance_may_be_said_to_be_unknown(make_trace: MakeTrace, unknown: Any) -> None:
    """As of `sensor_msgs` or as others do; recordings were refused for the one, and empty maps."""
    pose = Pose.planar(1.0, 2.0, 0.5)
    pose.covariance[: len(unknown)] = unknown
    trace = trace_from_cdr(trace_to_cdr(make_trace(pose=pose)))
    trace.validate()
    assert not trace.pose.covariance.any()


def test_an_unknown_encoding_is_named(make_trace: MakeTrace) -> None:
    with pytest.raises(MalformedMessageError) as raised:
        trace_from_cdr(changed(trace_to_cdr(make_trace()), encoding=9))
    assert str(raised.value) == "encoding: is 9, not one of 0 (RAW), 1 (ENVELOPE), 2 (IQ)"


def test_an_unknown_pulse_is_named(make_trace: MakeTrace) -> None:
    with pytest.raises(MalformedMessageError, match=r"^transducer.pulse_shape: is 7, not one of"):
        trace_from_cdr(changed(trace_to_cdr(make_trace()), transducer__pulse_shape=7))


@pytest.mark.parametrize(("seconds", "nanoseconds"), [(-1, 0), (1, 1_000_000_000)])
def test_an_impossible_stamp_is_named(
    make_trace: MakeTrace, seconds: int, nanoseconds: int
) -> None:
    written = trace_to_cdr(make_trace())
    wrong = written[:4] + struct.pack("<iI", seconds, nanoseconds) + written[12:]
    with pytest.raises(MalformedMessageError, match=r"^header.stamp: "):
        trace_from_cdr(wrong)


def test_a_stamp_beyond_the_message_is_refused(make_trace: MakeTrace) -> None:
    with pytest.raises(MalformedMessageError, match=r"^header.stamp: "):
        trace_to_cdr(make_trace(stamp_ns=2**62))
