"""A replay leaves room in the queues of those who fuse, and waits for none that is gone."""

from usmap_ros.live.backlog import Backlog


def report(waiting: object, room: object = 100) -> dict[str, str]:
    return {"waiting": str(waiting), "queue depth": str(room)}


def test_a_queue_is_full_by_its_report_and_by_what_was_sent_since() -> None:
    backlog = Backlog()
    assert not backlog.is_full(0.0)
    backlog.reported("/map_fusion", report(50), 0.0)
    for _ in range(29):
        backlog.sent()
    assert not backlog.is_full(0.5)
    backlog.sent()
    assert backlog.is_full(0.5)


def test_cones_under_way_at_a_report_count_until_the_next() -> None:
    backlog = Backlog()
    backlog.reported("/map_fusion", report(0), 0.0)
    for _ in range(80):
        backlog.sent()
    backlog.reported("/map_fusion", report(10), 1.0)
    assert backlog.is_full(1.0)
    backlog.reported("/map_fusion", report(70), 2.0)
    assert not backlog.is_full(2.0)


def test_who_reports_no_more_holds_nothing_up() -> None:
    backlog = Backlog()
    backlog.reported("/map_fusion", report(100), 0.0)
    assert backlog.is_full(15.0)
    assert not backlog.is_full(15.1)


def test_nodes_without_a_queue_are_not_waited_for() -> None:
    backlog = Backlog()
    backlog.reported("/robot1/cone_reconstructor", {"received": "3"}, 0.0)
    backlog.reported("/odd", report("many"), 0.0)
    assert not backlog
    assert not backlog.is_full(0.0)
