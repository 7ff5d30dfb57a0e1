"""A replay goes as far as its readers, and waits for none that will not answer."""

from usmap_ros.live.readers import FIRST_PATIENCE_S, LAG_S, PATIENCE_S, Readers

MS = 1_000_000
LAG_NS = LAG_S * 1e9


def test_time_stands_still_for_the_slowest_reader() -> None:
    readers = Readers()
    readers.add("a")
    readers.add("b")
    assert readers.limit_ns(0.0) == float("inf")
    for number in range(3):
        readers.sent("a", 100 * MS * number, 0.0)
        readers.sent("b", 100 * MS * number + MS, 0.0)
    assert readers.limit_ns(0.1) == LAG_NS
    readers.answered("a", 200 * MS, 0.1)
    assert readers.limit_ns(0.1) == MS + LAG_NS
    # The trace before was refused, and has no cone.
    readers.answered("b", 101 * MS, 0.1)
    assert readers.limit_ns(0.1) == 201 * MS + LAG_NS
    readers.answered("b", 201 * MS, 0.1)
    assert readers.limit_ns(0.1) == float("inf")


def test_nobody_is_waited_for_without_end() -> None:
    readers = Readers()
    readers.add("a")
    readers.sent("a", 0, 0.0)
    readers.sent("a", MS, 2.0)
    assert readers.limit_ns(FIRST_PATIENCE_S) == LAG_NS
    assert readers.limit_ns(FIRST_PATIENCE_S + 0.1) == float("inf")
    readers.sent("a", 2 * MS, 90.0)
    assert readers.limit_ns(90.0) == float("inf")
    readers.answered("a", 2 * MS, 90.0)
    readers.sent("a", 3 * MS, 90.0)
    assert readers.limit_ns(90.0 + PATIENCE_S) == 3 * MS + LAG_NS
    assert readers.limit_ns(90.1 + PATIENCE_S) == float("inf")


def test_what_nobody_reads_holds_nothing_up() -> None:
    readers = Readers()
    readers.sent("a", 0, 0.0)
    readers.answered("a", 0, 0.0)
    assert readers.limit_ns(0.0) == float("inf")
    assert not readers
