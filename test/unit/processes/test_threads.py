"""Work that is divided among threads."""

import os
import sys
import threading

import pytest

from usmap_ros.processes import threads
from usmap_ros.processes.threads import PATIENCE, alone, begun, for_each, give_way, in_turn


@pytest.mark.parametrize("cores", [1, 2, 5])
def test_results_come_in_the_order_of_the_parts(
    monkeypatch: pytest.MonkeyPatch, cores: int
) -> None:
    monkeypatch.setattr(threads, "available_cores", lambda: cores)
    assert for_each(lambda number: number**2, range(20)) == [number**2 for number in range(20)]


def test_what_a_part_raises_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "available_cores", lambda: 2)
    with pytest.raises(ZeroDivisionError):
        for_each(lambda number: 1 // number, [1, 0])


def test_what_is_begun_goes_on_beside() -> None:
    goes_on = threading.Event()
    waiting = begun(lambda: goes_on.wait(10.0))
    assert not waiting.done()
    goes_on.set()
    assert waiting.result()
    with pytest.raises(ZeroDivisionError):
        begun(lambda: 1 // 0).result()


def test_a_thread_that_is_to_work_alone_asks_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "available_cores", lambda: 2)
    with alone():
        assert set(for_each(lambda _: threading.get_ident(), range(9))) == {threading.get_ident()}
    together = threading.Barrier(2, timeout=10.0)
    assert sorted(for_each(lambda _: together.wait(), range(2))) == [0, 1]


def test_a_part_may_be_divided_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody waits for a thread that waits for it."""
    monkeypatch.setattr(threads, "available_cores", lambda: 2)
    together = threading.Barrier(2, timeout=10.0)

    def work(part: int) -> list[int]:
        together.wait()
        return for_each(lambda number: number + part, range(9))

    found = begun(lambda: for_each(work, [0, 10])).result(timeout=30.0)
    assert found == [list(range(9)), list(range(10, 19))]


@pytest.mark.parametrize("cores", [1, 2, 5])
def test_what_was_worked_out_ahead_of_a_change_is_worked_out_anew(
    monkeypatch: pytest.MonkeyPatch, cores: int
) -> None:
    """As a loop would do it that works everything out when its turn comes."""
    monkeypatch.setattr(threads, "available_cores", lambda: cores)
    taken: list[tuple[int, int]] = []
    changes = 0

    def take(part: int, result: int) -> bool:
        nonlocal changes
        taken.append((part, result))
        changes += part % 7 == 3
        return part % 7 == 3

    in_turn(lambda part: 100 * changes + part, range(40), take)
    assert taken == [(part, 100 * ((part + 3) // 7) + part) for part in range(40)]


def test_alone_nothing_is_worked_out_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "available_cores", lambda: 2)
    worked_out: list[int] = []
    with alone():
        in_turn(worked_out.append, range(9), lambda part, _: len(worked_out) != part + 1)
    assert worked_out == list(range(9))


@pytest.mark.skipif(sys.platform != "linux", reason="threads have no priorities")
def test_who_gives_way_does_so_with_all_threads_that_it_starts() -> None:
    def priority() -> int:
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    found: list[int] = []

    def work() -> None:
        give_way()
        found.append(priority())
        helper = threading.Thread(target=lambda: found.append(priority()))
        helper.start()
        helper.join()

    before = priority()
    worker = threading.Thread(target=work)
    worker.start()
    worker.join()
    assert found == 2 * [min(before + PATIENCE, 19)]
    assert priority() == before
