"""Which frame a map has where robots do not agree."""

from dataclasses import replace

from usmap_ros.mapping.common_frame import ENOUGH_PINGS, ENOUGH_S, CommonFrame
from usmap_ros.pings.cone import EchoCone


def ping(cone: EchoCone, number: int, frame_id: str) -> EchoCone:
    """One of pings that last longer than the opening."""
    step_s = ENOUGH_S / 10.0
    return replace(cone, stamp_ns=cone.stamp_ns + round(number * step_s * 1e9), frame_id=frame_id)


def test_one_odd_first_ping_does_not_name_the_frame(cone: EchoCone) -> None:
    frame, changes = CommonFrame(), []
    frame.add("/odd/cone", ping(cone, 0, "x"))
    assert frame.frame_id == "x"
    for number in range(1, ENOUGH_PINGS + 1):
        frame.add("/a/cone", ping(cone, number, "map"))
        changes.append(frame.decide())
    assert changes.count(True) == 1
    assert frame.frame_id == "map"
    assert frame.is_decided
    assert len(frame.take_held()) == ENOUGH_PINGS - 1
    assert not frame.take_held()


def test_a_robot_that_floods_has_one_vote(cone: EchoCone) -> None:
    frame = CommonFrame()
    for number in range(ENOUGH_PINGS):
        for _ in range(20):
            frame.add("/flood/cone", ping(cone, number, "x"))
        frame.add("/a/cone", ping(cone, number, "map"))
        frame.add("/b/cone", ping(cone, number, "map"))
    assert frame.decide()
    assert frame.frame_id == "map"


def test_a_stated_frame_is_not_voted_on(cone: EchoCone) -> None:
    frame = CommonFrame("map")
    assert frame.is_decided
    assert not any(
        frame.add("/a/cone", ping(cone, number, "x")) for number in range(2 * ENOUGH_PINGS)
    )
    assert not frame.decide()
    assert frame.frame_id == "map"
    assert not frame.take_held()


def test_what_comes_to_an_end_early_is_decided_by_what_there_is(cone: EchoCone) -> None:
    frame = CommonFrame()
    for number, frame_id in enumerate(["x", "map", "map"]):
        frame.add("/a/cone", ping(cone, number, frame_id))
    assert not frame.decide()
    assert frame.decide(is_over=True)
    assert frame.frame_id == "map"
