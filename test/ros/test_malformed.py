"""Messages that cannot be true leave every node alive, and are counted with the reason."""

import copy
from array import array
from collections.abc import Callable
from typing import Any

import pytest

from usmap_ros.live.health import Level
from usmap_ros.nodes.cone_reconstructor import ConeReconstructor
from usmap_ros.nodes.map_fusion import MapFusion
from usmap_ros.runs.pipeline import Pipeline

NAN = float("nan")
Change = Callable[[Any], None]


def _set(path: str, value: Any) -> Change:
    """Set a field, given with its dots, of a message."""

    def change(message: Any) -> None:
        *parents, last = path.split(".")
        for parent in parents:
            message = getattr(message, parent)
        setattr(message, last, value)

    return change


OF_BOTH = {
    "NaN pose": (_set("pose.pose.position.x", NAN), "pose.position"),
    "infinite pose": (_set("pose.pose.position.y", float("inf")), "pose.position"),
    "non-unit quaternion": (_set("pose.pose.orientation.w", 3.0), "pose.orientation"),
    "NaN quaternion": (_set("pose.pose.orientation.z", NAN), "pose.orientation"),
    "NaN covariance": (
        lambda message: message.pose.covariance.__setitem__(0, NAN),
        "pose.covariance",
    ),
    "no frame": (_set("header.frame_id", ""), "frame_id"),
    "negative stamp": (_set("header.stamp.sec", -5), "stamp"),
    "unknown pulse": (_set("transducer.pulse_shape", 77), "pulse_shape"),
    "no beam": (_set("transducer.beam_angles", array("d")), "beam"),
    "wrong length of the beam": (_set("transducer.beam_gains", array("d", [1.0])), "beam"),
    "NaN range": (_set("transducer.max_range", NAN), "range"),
    "absurd range": (_set("transducer.max_range", 1e300), "range"),
}
OF_TRACES = {
    **OF_BOTH,
    "no samples": (_set("samples", array("f")), "samples"),
    "odd number of I/Q samples": (_set("samples", array("f", [0.0] * 7)), "samples"),
    "NaN samples": (_set("samples", array("f", [NAN] * 1000)), "samples"),
    "absurd rate": (_set("sample_rate", 1e15), "sample_rate"),
    "zero rate": (_set("sample_rate", 0.0), "sample_rate"),
    "negative rate": (_set("sample_rate", -25e3), "sample_rate"),
    "zero sound speed": (_set("sound_speed", 0.0), "sound_speed"),
    "NaN attenuation": (_set("attenuation", NAN), "attenuation"),
    "negative floor": (_set("floor_height", -1.0), "floor_height"),
    "unknown encoding": (_set("encoding", 9), "encoding"),
    "NaN noise": (_set("noise_std", NAN), "noise_std"),
    "negative delay": (_set("start_delay", -1.0), "start_delay"),
}
OF_CONES = {
    **OF_BOTH,
    "pose on the moon": (_set("pose.pose.position.x", 3.8e8), "pose.position"),
    "wrong length": (lambda message: message.amplitudes.append(1.0), "amplitudes"),
    "farther than the map": (_set("transducer.max_range", 900.0), "range"),
    "NaN amplitudes": (
        lambda message: [
            setattr(message, name, array("f", [NAN, NAN]))
            for name in ("ranges", "range_stds", "amplitudes", "amplitude_stds")
        ],
        "ranges",
    ),
    "zero step": (_set("limit_step", 0.0), "limit_step"),
    "NaN attenuation": (_set("attenuation", NAN), "attenuation"),
    "no limits": (_set("detection_limits", array("B")), "detection_limits"),
}


def assert_all_are_refused(
    live: Any, node: Any, publisher: Any, sound: Any, cases: dict[str, tuple[Change, str]]
) -> None:
    """Each change of a sound message is counted as malformed, with the field that it is of."""
    for number, (name, (change, field)) in enumerate(cases.items()):
        message = copy.deepcopy(sound)
        change(message)
        publisher.publish(message)
        live.until(lambda n=number: node.health.total("malformed") == n + 1, what=name)
        assert field in node.health.reason("malformed"), name
    assert node.health.total("failed") == 0


def test_no_malformed_trace_stops_the_reconstructor(live: Any, trace_message: Any) -> None:
    node = live.add(ConeReconstructor, diagnostics_period_s=0.1)
    cones = live.listen("usmap_msgs/msg/EchoCone", "/cone", 50)
    diagnostics = live.listen("diagnostic_msgs/msg/DiagnosticArray", "/diagnostics", 50)
    echo = live.publisher("usmap_msgs/msg/EchoTrace", "/echo")
    assert_all_are_refused(live, node, echo, trace_message, OF_TRACES)
    echo.publish(trace_message)
    live.until(lambda: cones)
    counted = {"malformed": str(len(OF_TRACES)), "published": "1"}

    def is_told() -> bool:
        facts = [{v.key: v.value for v in s.values} for m in diagnostics for s in m.status]
        return any(counted.items() <= fact.items() for fact in facts)

    live.until(is_told)


def test_no_malformed_cone_stops_the_fusion(live: Any, cone_message: Any) -> None:
    node = live.add(MapFusion)
    publisher = live.publisher("usmap_msgs/msg/EchoCone", "/robot1/cone", 50)
    assert_all_are_refused(live, node, publisher, cone_message, OF_CONES)
    publisher.publish(cone_message)
    live.until(lambda: node.health.total("fused") == 1)
    cone_message.pose.pose.position.x = 1e6
    publisher.publish(cone_message)
    live.until(lambda: node.health.total("set apart") == 1)
    assert "m away from all pings that are mapped" in node.health.reason("set apart")


@pytest.mark.parametrize(
    ("node_class", "message_type", "topic"),
    [
        (ConeReconstructor, "usmap_msgs/msg/EchoTrace", "/echo"),
        (MapFusion, "usmap_msgs/msg/EchoCone", "/robot1/cone"),
    ],
)
def test_bytes_that_are_no_message_are_counted(
    live: Any, node_class: Any, message_type: str, topic: str
) -> None:
    node = live.add(node_class)
    publisher = live.publisher(message_type, topic, 50)
    for number, payload in enumerate((bytes.fromhex("00010000"), b"nonsense" * 50)):
        publisher.publish(payload)
        live.until(lambda n=number: node.health.total("malformed") == n + 1)
        assert "cannot be decoded" in node.health.reason("malformed")
    assert node.health.total("failed") == 0


def test_time_that_jumps_back_is_counted_and_mapping_goes_on(live: Any, cone_message: Any) -> None:
    node = live.add(MapFusion, order_wait_s=0.2)
    publisher = live.publisher("usmap_msgs/msg/EchoCone", "/robot1/cone", 50)
    publisher.publish(cone_message)
    live.until(lambda: node.health.total("fused") == 1)
    cone_message.header.stamp.sec -= 1000
    for number in range(5):
        cone_message.header.stamp.sec += 1
        publisher.publish(cone_message)
        live.until(lambda n=number: node.health.total("fused") == n + 2)
    assert node.health.total("late") == 1
    assert "order_wait_s" in node.health.reason("late")


def test_a_stamp_in_the_far_future_delays_nobody(live: Any, cone_message: Any) -> None:
    node = live.add(MapFusion, order_wait_s=0.2)
    broken = live.publisher("usmap_msgs/msg/EchoCone", "/broken/cone", 50)
    sound = live.publisher("usmap_msgs/msg/EchoCone", "/robot1/cone", 50)
    future = copy.deepcopy(cone_message)
    future.header.stamp.sec = 2**31 - 1
    broken.publish(future)
    live.until(lambda: node.health.total("fused") == 1)
    sound.publish(cone_message)
    live.until(lambda: node.health.total("fused") == 2)


def test_an_error_nobody_thought_of_costs_one_message(
    live: Any, trace_message: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = live.add(ConeReconstructor)
    # What went wrong shows for some seconds: here, for as long as the test takes.
    monkeypatch.setattr(node.health, "clock", lambda: 0.0)
    reconstruct = Pipeline.reconstruct_sounding

    def broken(pipeline: Pipeline, sounding: Any) -> Any:
        monkeypatch.setattr(Pipeline, "reconstruct_sounding", reconstruct)
        raise ZeroDivisionError("nobody thought of this")

    monkeypatch.setattr(Pipeline, "reconstruct_sounding", broken)
    echo = live.publisher("usmap_msgs/msg/EchoTrace", "/echo")
    echo.publish(trace_message)
    live.until(lambda: node.health.total("failed") == 1)
    echo.publish(trace_message)
    live.until(lambda: node.health.total("published") == 1)
    assert node.health.report().level == Level.ERROR
