"""Messages of several sources come in the order of their stamps, within a bounded wait."""

from hypothesis import given
from hypothesis import strategies as st

from usmap_ros.live.ordering import QUIET_S, STANDSTILL_S, StampOrder

WAIT_S = 0.5
SECOND = 1_000_000_000


def _drain(order: StampOrder[str], now_s: float) -> list[str]:
    items = []
    while (released := order.pop(now_s)) is not None:
        items.append(released[1])
    return items


def _order(capacity: int = 100) -> StampOrder[str]:
    order: StampOrder[str] = StampOrder(WAIT_S, capacity)
    order.add_source("a")
    order.add_source("b")
    return order


def test_a_message_waits_for_sources_that_have_not_spoken_yet() -> None:
    order = _order()
    order.push("b", 20, "b20", 0.0)
    assert _drain(order, 0.1) == []
    order.push("a", 10, "a10", 0.1)
    assert _drain(order, 0.1) == ["a10"]
    order.push("a", 30, "a30", 0.2)
    assert _drain(order, 0.2) == ["b20"]


def test_a_silent_source_holds_the_others_up_once() -> None:
    order = _order()
    order.push("a", 10, "a10", 0.0)
    order.push("a", 10 + SECOND, "a1010", 0.1)
    assert order.due_in_s(0.1) == 0.4
    assert _drain(order, 0.5) == ["a10", "a1010"]
    order.push("a", 2 * SECOND, "a2000", 0.6)
    assert _drain(order, 0.6) == ["a2000"]
    order.push("b", 2 * SECOND + 1, "b2001", 0.7)
    order.push("a", 3 * SECOND, "a3000", 0.7)
    assert _drain(order, 0.7) == ["b2001"]


def test_nobody_is_silent_whose_stamps_are_not_overtaken() -> None:
    """However long this process was busy: what it has not read yet may be there already."""
    order = _order()
    order.push("a", 10, "a10", 0.0)
    order.push("a", SECOND // 10, "a100", 0.0)
    assert _drain(order, 1.9) == []
    order.push("b", 20, "b20", 1.9)
    assert _drain(order, 1.9) == ["a10", "b20"]


def test_what_is_held_goes_out_when_nothing_comes_any_more() -> None:
    order = _order()
    order.push("a", 10, "a10", 0.0)
    order.push("a", 20, "a20", 1.0)
    assert order.due_in_s(1.0) == QUIET_S
    assert _drain(order, 1.0 + QUIET_S) == ["a10", "a20"]


def test_nobody_is_silent_while_time_stands_still() -> None:
    order = _order()
    order.push("a", 10, "a10", 0.0)
    for second in range(1, int(STANDSTILL_S)):
        order.stand_still(float(second))
        assert _drain(order, float(second)) == []
    order.push("b", 5, "b5", STANDSTILL_S)
    assert _drain(order, STANDSTILL_S) == ["b5"]
    assert order.late == 0


def test_time_that_stands_still_for_ever_holds_nothing_back_for_ever() -> None:
    order = _order()
    order.push("a", 10, "a10", 0.0)
    for second in range(1, int(STANDSTILL_S + QUIET_S) + 2):
        order.stand_still(float(second))
    assert _drain(order, STANDSTILL_S + QUIET_S) == ["a10"]


def test_a_source_that_left_is_not_waited_for() -> None:
    order = _order()
    order.push("a", 10, "a10", 0.0)
    order.remove_source("b")
    assert order.due_in_s(0.0) == 0.0
    assert _drain(order, 0.0) == ["a10"]
    assert order.due_in_s(0.0) is None


def test_equal_stamps_come_in_the_order_of_their_sources() -> None:
    order = _order()
    order.push("b", 10, "b10", 0.0)
    order.push("a", 10, "a10", 0.0)
    assert _drain(order, 0.0) == ["a10", "b10"]


def test_what_comes_too_late_is_counted_and_released_all_the_same() -> None:
    order = _order()
    order.push("a", 20, "a20", 0.0)
    assert _drain(order, QUIET_S) == ["a20"]
    order.push("b", 10, "b10", QUIET_S)
    assert _drain(order, QUIET_S) == ["b10"]
    assert order.late == 1


def test_the_oldest_is_dropped_when_there_are_too_many() -> None:
    order = _order(capacity=2)
    for stamp in (30, 10, 20):
        order.push("a", stamp, f"a{stamp}", 0.0)
    assert order.dropped == 1
    assert _drain(order, QUIET_S) == ["a20", "a30"]


def test_one_who_floods_takes_the_room_of_nobody_else() -> None:
    order = _order(capacity=10)
    for stamp in range(3):
        order.push("a", stamp, f"a{stamp}", 0.0)
    for stamp in range(500):
        order.push("b", stamp, f"b{stamp}", 0.0)
    assert len(order) == 10
    assert order.dropped == 493
    released = _drain(order, QUIET_S)
    assert [item for item in released if item[0] == "a"] == ["a0", "a1", "a2"]
    assert released[-1] == "b499"
    assert len(order) == 0


def test_a_clock_of_1970_holds_nobody_up_and_is_named() -> None:
    order = _order()
    now_ns = 1_700_000_000_000_000_000
    for number in range(5):
        order.push("odd", number, f"odd{number}", 0.0)
        order.push("a", now_ns + number, f"a{number}", 0.0)
        order.push("b", now_ns + number, f"b{number}", 0.0)
        # At once, and not after the wait that a silent source is given.
        assert _drain(order, 0.0) == [f"odd{number}", f"a{number}", f"b{number}"]
    assert order.late == 4
    assert order.last_late == "odd, 1.7e+09 s behind"


def test_a_clock_that_is_set_back_does_not_stop_a_source() -> None:
    order = _order()
    order.push("a", 1000, "a1000", 0.0)
    order.push("b", 1000, "b1000", 0.0)
    assert _drain(order, 0.0) == ["a1000", "b1000"]
    order.push("a", 5, "a5", 0.1)
    order.push("b", 6, "b6", 0.1)
    assert _drain(order, 0.1) == ["a5"]
    order.clear()
    assert len(order) == 0


@given(
    st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 50)), max_size=60),
    st.randoms(use_true_random=False),
)
def test_the_order_of_arrival_does_not_matter(
    messages: list[tuple[str, int]], random: object
) -> None:
    by_source = {name: sorted({s for n, s in messages if n == name}) for name in "abc"}
    order: StampOrder[tuple[int, str]] = StampOrder(WAIT_S, 1000)
    for name in "abc":
        order.add_source(name)
    pending = {name: list(stamps) for name, stamps in by_source.items()}
    released = []
    while any(pending.values()):
        name = random.choice([n for n in "abc" if pending[n]])  # type: ignore[attr-defined]
        stamp = pending[name].pop(0)
        order.push(name, stamp, (stamp, name), 0.0)
        while (item := order.pop(0.0)) is not None:
            released.append(item[1])
    while (item := order.pop(QUIET_S)) is not None:
        released.append(item[1])
    assert released == sorted((stamp, name) for name in "abc" for stamp in by_source[name])
    assert order.late == 0


def test_who_yields_comes_when_no_others_can() -> None:
    order = _order()
    for stamp in (10, 20):
        order.push("b", stamp, f"b{stamp}", 0.0)
        order.push("a", stamp + 5, f"a{stamp + 5}", 0.0)
    released = [order.pop(0.0, ["b"]) for _ in range(3)]
    # a25 has to wait for b, which may have one between.
    assert released == [("a", "a15"), ("b", "b10"), ("b", "b20")]
    assert order.longest_wait_s(2.0) == 2.0
    order.push("b", 30, "b30", 2.0)
    assert order.pop(2.0, ["b"]) == ("a", "a25")
    assert order.pop(2.0, ["b"]) is None
    assert len(order) == 1
