from array import array
from collections.abc import Callable
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.cone import EchoCone
from usmap_ros.errors import MalformedMessageError
from usmap_ros.geometry import Pose
from usmap_ros.io.conversions import (
    array_from_message,
    array_to_message,
    cone_from_message,
    cone_to_message,
    trace_from_message,
    trace_to_message,
)
from usmap_ros.io.message_types import (
    ECHO_CONE,
    ECHO_TRACE,
    TRANSDUCER_ARRAY,
    BagMessageTypes,
    typestore,
)
from usmap_ros.trace import EchoTrace
from usmap_ros.transducer_array import TransducerArray

MakeTrace = Callable[..., EchoTrace]


class ClientLibraryTypes:
    """Stands for rclpy: sequences are array.array, classes take keywords."""

    def message_class(self, name: str) -> Any:
        return SimpleNamespace

    def sequence(self, values: np.ndarray) -> array:
        filled = array(values.dtype.char)
        filled.frombytes(memoryview(values.view(np.uint8)))
        return filled


@pytest.fixture(params=[BagMessageTypes, ClientLibraryTypes])
def types(request: pytest.FixtureRequest) -> Any:
    return request.param()


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


def test_a_trace_survives_the_round_trip(make_trace: MakeTrace, types: Any) -> None:
    trace = make_trace()
    assert_same(trace_from_message(trace_to_message(trace, types)), trace)


def test_a_cone_survives_the_round_trip(cone: EchoCone, types: Any) -> None:
    assert_same(cone_from_message(cone_to_message(cone, types)), cone)


def test_bearings_survive_the_round_trip(cone: EchoCone, types: Any) -> None:
    bearings = np.array([-0.2, np.nan], dtype=np.float32)
    told = replace(cone, bearings_rad=bearings, bearing_stds_rad=np.abs(0.1 * bearings))
    assert_same(cone_from_message(cone_to_message(told, types)), told)


def test_an_array_survives_the_round_trip(array: TransducerArray, types: Any) -> None:
    assert_same(array_from_message(array_to_message(array, types)), array)


def test_an_array_survives_serialization(array: TransducerArray) -> None:
    raw = typestore().serialize_cdr(array_to_message(array, BagMessageTypes()), TRANSDUCER_ARRAY)
    assert_same(array_from_message(typestore().deserialize_cdr(raw, TRANSDUCER_ARRAY)), array)


def test_an_impossible_array_is_refused(array: TransducerArray) -> None:
    message = array_to_message(replace(array, elements=array.elements[:1] * 2), BagMessageTypes())
    with pytest.raises(MalformedMessageError, match=r"TransducerArray\.elements\.child_frame_id"):
        array_from_message(message)


def test_a_trace_survives_serialization(make_trace: MakeTrace) -> None:
    trace = make_trace()
    raw = typestore().serialize_cdr(trace_to_message(trace, BagMessageTypes()), ECHO_TRACE)
    assert_same(trace_from_message(typestore().deserialize_cdr(raw, ECHO_TRACE)), trace)


def test_a_cone_survives_serialization(cone: EchoCone) -> None:
    raw = typestore().serialize_cdr(cone_to_message(cone, BagMessageTypes()), ECHO_CONE)
    assert_same(cone_from_message(typestore().deserialize_cdr(raw, ECHO_CONE)), cone)


def test_samples_are_not_copied(make_trace: MakeTrace, types: Any) -> None:
    message = trace_to_message(make_trace(), types)
    samples = trace_from_message(message).samples
    assert np.shares_memory(samples, np.asarray(message.samples))


def beam(angles: list[float], gains: list[float]) -> BeamPattern:
    return BeamPattern(np.array(angles), np.array(gains))


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"frame_id": ""}, "header.frame_id"),
        ({"samples": np.full(400, np.nan, np.float32)}, "samples"),
        ({"samples": np.zeros(0, np.float32)}, "samples"),
        ({"samples": np.zeros(7, np.float32)}, "samples"),
        ({"sample_rate_hz": 0.0}, "sample_rate"),
        ({"sample_rate_hz": 1e12}, "sample_rate"),
        ({"start_delay_s": float("nan")}, "start_delay"),
        ({"noise_std": -1.0}, "noise_std"),
        ({"channel": Channel(0.0)}, "sound_speed"),
        ({"channel": Channel(343.0, floor_reflectivity=2.0)}, "floor_reflectivity"),
        ({"pose": Pose.planar(float("nan"), 0.0, 0.0)}, "pose.position"),
        ({"pose": Pose(np.zeros(3), np.full(4, 0.9))}, "pose.orientation"),
        ({"pose": Pose(np.zeros(3), np.array([0, 0, 0, 1.0]), -np.eye(6))}, "pose.covariance"),
    ],
)
def test_what_cannot_be_true_is_named(
    make_trace: MakeTrace, types: Any, changes: dict[str, Any], field: str
) -> None:
    message = trace_to_message(make_trace(**changes), types)
    with pytest.raises(MalformedMessageError) as raised:
        trace_from_message(message)
    assert raised.value.field == field
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("pattern", "field"),
    [
        (beam([0.0, 0.7], [1.0]), "transducer.beam_angles"),
        (beam([0.1, 0.7], [1.0, 0.0]), "transducer.beam_angles"),
        (beam([0.0, 0.7], [1.0, -0.5]), "transducer.beam_gains"),
    ],
)
def test_an_impossible_transducer_is_named(
    make_trace: MakeTrace, types: Any, pattern: BeamPattern, field: str
) -> None:
    trace = make_trace()
    trace = replace(trace, transducer=replace(trace.transducer, beam=pattern))
    with pytest.raises(MalformedMessageError) as raised:
        trace_from_message(trace_to_message(trace, types))
    assert raised.value.field == field


@pytest.mark.parametrize(
    ("field", "value", "cause"),
    [
        ("encoding", 9, "encoding: is 9, not one of 0 (RAW), 1 (ENVELOPE), 2 (IQ)"),
        ("samples", np.zeros((2, 2)), "samples: has 2 dimensions instead of 1"),
        ("samples", "noise", "samples: is no array of float32"),
    ],
)
def test_unknown_values_are_named(
    make_trace: MakeTrace, field: str, value: Any, cause: str
) -> None:
    message = trace_to_message(make_trace(), ClientLibraryTypes())
    setattr(message, field, value)
    with pytest.raises(MalformedMessageError) as raised:
        trace_from_message(message)
    assert str(raised.value) == cause


def test_an_unknown_pulse_is_named(make_trace: MakeTrace) -> None:
    message = trace_to_message(make_trace(), ClientLibraryTypes())
    message.transducer.pulse_shape = 7
    with pytest.raises(MalformedMessageError, match=r"^transducer.pulse_shape: is 7, not one of"):
        trace_from_message(message)


@pytest.mark.parametrize(("seconds", "nanoseconds"), [(-1, 0), (1, 1_000_000_000)])
def test_an_impossible_stamp_is_named(
    make_trace: MakeTrace, seconds: int, nanoseconds: int
) -> None:
    message = trace_to_message(make_trace(), ClientLibraryTypes())
    message.header.stamp = SimpleNamespace(sec=seconds, nanosec=nanoseconds)
    with pytest.raises(MalformedMessageError, match=r"^header.stamp: "):
        trace_from_message(message)


def test_a_covariance_of_another_size_is_named(make_trace: MakeTrace) -> None:
    message = trace_to_message(make_trace(), ClientLibraryTypes())
    message.pose.covariance = np.zeros(9)
    with pytest.raises(MalformedMessageError, match=r"^pose.covariance: has 9 entries, not 36"):
        trace_from_message(message)


def test_a_stamp_beyond_the_message_is_refused(make_trace: MakeTrace) -> None:
    with pytest.raises(MalformedMessageError, match=r"^header.stamp: "):
        trace_to_message(make_trace(stamp_ns=2**62), ClientLibraryTypes())
