"""A replay begins when all who will listen are known to those whom they listen to."""

from usmap_ros.live.attendance import LISTENERS, SETTLING_S, Attendance

NODE = "/robot1/cone_reconstructor"


def test_without_reconstructors_it_begins_as_soon_as_all_listen() -> None:
    attendance = Attendance(5.0)
    assert not attendance.is_complete(0.0, ["/robot1/echo"], {})
    assert attendance.is_complete(0.1, [], {})


def test_nobody_is_waited_for_for_ever() -> None:
    attendance = Attendance(5.0)
    assert not attendance.is_complete(4.9, ["/robot1/echo"], {NODE: 2})
    assert attendance.is_complete(5.0, ["/robot1/echo"], {NODE: 2})


def test_a_reconstructor_that_does_not_know_of_fusion_yet_is_waited_for() -> None:
    """It would publish its first cones to nobody, and nobody would ever know."""
    attendance = Attendance(60.0)
    for now_s, known in ((0.0, 1), (1.0, 1), (2.0, 2)):
        attendance.reported(NODE, {LISTENERS: str(known)})
        assert not attendance.is_complete(now_s, [], {NODE: 2})
    assert attendance.is_complete(2.0 + SETTLING_S, [], {NODE: 2})


def test_one_who_reports_nothing_of_listeners_tells_nothing() -> None:
    attendance = Attendance(5.0)
    attendance.reported(NODE, {"received": "3"})
    attendance.reported(NODE, {LISTENERS: "many"})
    assert not attendance.is_complete(1.0, [], {NODE: 2})


def test_a_reconstructor_that_is_seen_late_is_waited_for() -> None:
    """Its subscription to traces may be seen before its cones are."""
    attendance = Attendance(60.0)
    attendance.reported(NODE, {LISTENERS: "2"})
    other = "/robot2/cone_reconstructor"
    assert not attendance.is_complete(0.0, [], {NODE: 2})
    assert not attendance.is_complete(0.4, [], {NODE: 2, other: 2})
    attendance.reported(other, {LISTENERS: "2"})
    assert not attendance.is_complete(0.6, [], {NODE: 2, other: 2})
    assert attendance.is_complete(0.6 + SETTLING_S, [], {NODE: 2, other: 2})
