"""The map while pings come: what it costs, and what it tells."""

import threading
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from usmap_ros.grids import OccupancyMap
from usmap_ros.mapping.joint import explanation, live_map, more_pings
from usmap_ros.mapping.joint.area_state import AreaState
from usmap_ros.mapping.joint.estimate import JointEstimate
from usmap_ros.mapping.joint.free_space.free_space import FreeSpace
from usmap_ros.mapping.joint.free_space.one_sided import LEAST_HEARD
from usmap_ros.mapping.joint.free_space.refutation import Refutations
from usmap_ros.mapping.joint.fusion import JointFusion
from usmap_ros.mapping.joint.more_pings import MorePings, add_overdispersed
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

#: Another object, which later pings hear.
LATE = (1.0, -0.9, 0.6)
#: What is so near to a thing is of it, m.
NEAR_M = 0.1
KNOWN, BATCH = 8, 4
#: Nothing that a test waits for takes as long.
WAIT_S = 300.0


@pytest.fixture(scope="module")
def pings(cone_of_objects: Callable[..., EchoCone]) -> list[EchoCone]:
    """Give pings on a way around two objects, the later half of which hear a third one."""
    objects, angles = [(0.3, 0.2, 0.6), (-0.4, -0.1, 0.4)], np.linspace(0.0, 4.0 * np.pi, 40)
    return [
        cone_of_objects(
            *(objects if number < 20 else [*objects, LATE]), stamp_ns=number,
            x_m=1.7 * np.cos(angle), y_m=1.6 * np.sin(angle), yaw_rad=angle + np.pi,
        )
        for number, angle in enumerate(angles)
    ]  # fmt: skip


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let few pings be many."""
    monkeypatch.setattr(live_map, "FEW_PINGS", KNOWN)
    monkeypatch.setattr(live_map, "BATCH", BATCH)
    monkeypatch.setattr(live_map, "TOGETHER", 1)


@pytest.fixture
def visits(few: None, monkeypatch: pytest.MonkeyPatch) -> dict[str, list[int]]:
    """Give how many pings were explained together, and how many beside others, at each time."""
    counts: dict[str, list[int]] = {"all": [], "more": []}

    class Whole(JointEstimate):
        def __init__(self, table: Any, pings: Any, *others: Any, **named: Any) -> None:
            counts["all"].append(len(pings))
            super().__init__(table, pings, *others, **named)

    class More(MorePings):
        def __init__(self, pings: Any, parameters: MappingParameters) -> None:
            counts["more"].append(len(pings.rows))
            super().__init__(pings, parameters)

    monkeypatch.setattr(explanation, "JointEstimate", Whole)
    monkeypatch.setattr(live_map, "MorePings", More)
    return counts


def fuse(fusion: JointFusion, pings: list[EchoCone]) -> None:
    for ping in pings:
        fusion.fuse(ping)


def fused(pings: list[EchoCone], is_looked_at: bool = False) -> JointFusion:
    """All pings, perhaps with a look at the map after each."""
    fusion = JointFusion(MappingParameters())
    for ping in pings:
        fusion.fuse(ping)
        if is_looked_at:
            fusion.live_snapshot()()
    return fusion


def known(pings: list[EchoCone]) -> JointFusion:
    """All pings, explained together."""
    fusion = fused(pings)
    fusion.live_snapshot()()
    return fusion


def assert_same(one: OccupancyMap, other: OccupancyMap) -> None:
    np.testing.assert_array_equal(one.log_odds, other.log_odds)


def is_there(occupancy: OccupancyMap, x_m: float, y_m: float) -> bool:
    left_m, bottom_m = occupancy.geometry.origin_m
    row, column = int((y_m - bottom_m) / 0.05), int((x_m - left_m) / 0.05)
    return bool(occupancy.predicted()[row - 1 : row + 2, column - 1 : column + 2].any())


def is_free(occupancy: OccupancyMap, x_m: float, y_m: float) -> bool:
    left_m, bottom_m = occupancy.geometry.origin_m
    place = int((y_m - bottom_m) / 0.05), int((x_m - left_m) / 0.05)
    return bool(occupancy.observed[place] and not occupancy.predicted()[place])


def test_new_pings_alone_are_visited(pings: list[EchoCone], visits: dict[str, list[int]]) -> None:
    fused(pings, is_looked_at=True)
    # All of them at counts that grow by half at least each time, beyond the first few.
    late = [count for count in visits["all"] if count >= KNOWN]
    assert len(late) >= 3
    assert all(later > 1.5 * earlier for earlier, later in pairwise(late))
    assert visits["more"]
    assert max(visits["more"]) <= BATCH


def test_it_tells_what_new_pings_say(
    pings: list[EchoCone], visits: dict[str, list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    fusion = fused(pings[:20], is_looked_at=True)
    fusion.live_snapshot()()
    monkeypatch.setattr(live_map, "MORE_SHARE", 10.0)
    assert not is_there(fusion.live_snapshot()(), *LATE[:2])
    before = len(visits["all"])
    fuse(fusion, pings[20:])
    late = fusion.live_snapshot()()
    assert len(visits["all"]) == before
    whole = fused(pings).occupancy_map()
    for x_m, y_m in ((0.3, 0.2), (-0.4, -0.1), LATE[:2]):
        assert is_there(whole, x_m, y_m)
        assert not is_free(late, x_m, y_m)
    assert is_there(late, 0.3, 0.2)
    assert is_there(late, -0.4, -0.1)
    assert np.count_nonzero(late.observed) > 0.8 * np.count_nonzero(whole.observed)


def test_the_whole_map_does_not_depend_on_looks(
    pings: list[EchoCone], visits: dict[str, list[int]]
) -> None:
    looked, alone = fused(pings, is_looked_at=True), fused(pings)
    is_whole = [looked.is_whole]
    one, other = looked.occupancy_map(), alone.occupancy_map()
    assert_same(one, other)
    assert_same(looked.live_snapshot()(), other)
    assert [*is_whole, looked.is_whole] == [False, True]


def test_how_often_one_looks_does_not_matter(
    pings: list[EchoCone], visits: dict[str, list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_map, "MORE_SHARE", 10.0)
    often, seldom = known(pings[:10]), known(pings[:10])
    for ping in pings[10:]:
        often.fuse(ping)
        seldom.fuse(ping)
        often.live_snapshot()()
    assert_same(often.live_snapshot()(), seldom.live_snapshot()())


def test_more_pings_are_explained_at_once_while_many_wait(
    pings: list[EchoCone], visits: dict[str, list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_map, "MORE_SHARE", 10.0)
    monkeypatch.setattr(live_map, "TOGETHER", 3)
    fusion = known(pings[:10])
    fuse(fusion, pings[10:30])
    fusion.live_snapshot()()
    assert visits["more"] == [3 * BATCH, 2 * BATCH]


def test_maps_in_time_tell_of_some_while_many_wait(
    pings: list[EchoCone], visits: dict[str, list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_map, "MORE_SHARE", 10.0)
    fusion, at_once = known(pings[:10]), known(pings[:10])
    fuse(fusion, pings[10:21])
    fuse(at_once, pings[10:21])
    stamps_ns, are_behind = list[int](), list[bool]()
    for _ in range(3):
        occupancy = fusion.live_snapshot(in_time=True)()
        stamps_ns.append(occupancy.stamp_ns)
        are_behind.append(fusion.is_behind)
    # Each says what the newest ping is that it tells of.
    assert stamps_ns == [13, 17, 20]
    assert are_behind == [True, True, False]
    assert_same(occupancy, at_once.live_snapshot()())


def test_what_new_pings_heard_tells_where_sound_came_back_from(
    pings: list[EchoCone], few: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thing that nobody had heard before is where it is drawn if they heard it from all sides."""
    heard: list[float] = []

    class Space(FreeSpace):
        def more(self, *given: Any) -> Refutations:
            there = self._field.cells_within(*np.array(LATE[:2])[:, np.newaxis], NEAR_M)
            heard.append(float(given[5].heard[there.ravel()].sum()))
            return super().more(*given)

    monkeypatch.setattr(live_map, "MORE_SHARE", 10.0)
    monkeypatch.setattr(more_pings, "FreeSpace", Space)
    fusion = known(pings[:10])
    fuse(fusion, pings[34:40])
    fusion.live_snapshot()()
    assert heard[0] > LEAST_HEARD


def test_a_map_without_news_takes_no_work(
    pings: list[EchoCone], visits: dict[str, list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_map, "MORE_SHARE", 10.0)
    fusion = known(pings[:10])
    fuse(fusion, pings[10:13])
    before = fusion.live_snapshot()()
    visited = len(visits["more"])
    # From a place that it has been heard from.
    fusion.fuse(replace(pings[12], stamp_ns=100))
    after = fusion.live_snapshot()()
    assert len(visits["more"]) == visited
    assert after.stamp_ns == 100
    assert_same(after, before)


def test_pings_are_taken_up_while_a_map_is_made(
    pings: list[EchoCone], visits: dict[str, list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    fusion = known(pings[:10])
    fusion.fuse(pings[10])
    waiting = pings[11:14]

    class More(MorePings):
        def add_to(self, known: AreaState) -> AreaState:
            if waiting:
                taker = threading.Thread(target=fusion.fuse, args=(waiting.pop(0),))
                taker.start()
                taker.join(WAIT_S)
                assert not taker.is_alive()
            return super().add_to(known)

    monkeypatch.setattr(live_map, "MorePings", More)
    fusion.live_snapshot()()
    assert len(waiting) == 2
    assert_same(fusion.occupancy_map(), fused(pings[:12]).occupancy_map())


def test_pings_that_strike_no_known_mirror_are_taken_up(
    mirror_pings: list[EchoCone],
    make_cone: Callable[..., EchoCone],
    visits: dict[str, list[int]],
) -> None:
    fusion = fused(mirror_pings)
    before = fusion.live_snapshot()()
    fusion.fuse(make_cone(stamp_ns=100, x_m=1.0, yaw_rad=-0.5 * np.pi))
    live = fusion.live_snapshot()()
    assert visits["more"] == [1]
    assert np.count_nonzero(live.observed) > np.count_nonzero(before.observed)


def test_where_nothing_is_known_all_pings_are_explained_together(
    pings: list[EchoCone], visits: dict[str, list[int]]
) -> None:
    fusion = fused(pings, is_looked_at=True)
    fusion.occupancy_map()
    far = replace(pings[0].pose, position_m=pings[0].pose.position_m + np.array([40.0, 0.0, 0.0]))
    fusion.fuse(replace(pings[0], pose=far, stamp_ns=100))
    live = fusion.live_snapshot()()
    assert_same(live, fusion.occupancy_map())


def test_who_is_left_out_is_in_no_later_map(
    pings: list[EchoCone], visits: dict[str, list[int]]
) -> None:
    fusion = JointFusion(MappingParameters())
    for number, ping in enumerate(pings):
        fusion.fuse(ping, "odd" if number >= 20 else "sound")
        fusion.live_snapshot()()
    fusion.leave_out(lambda source: source == "odd")
    assert_same(fusion.live_snapshot()(), fused(pings[:20]).occupancy_map())


class Held:
    """A thread beside, which explains all pings together and waits before it is done."""

    def __init__(self) -> None:
        self.begun, self.may_go_on = threading.Event(), threading.Event()

    def wait(self) -> threading.Thread:
        """Wait until it has begun."""
        assert self.begun.wait(WAIT_S)
        return next(one for one in threading.enumerate() if one.name == live_map.BESIDE)

    def finish(self) -> None:
        """Let it go on to its end."""
        thread = self.wait()
        self.may_go_on.set()
        thread.join()


@pytest.fixture
def held(few: None, monkeypatch: pytest.MonkeyPatch) -> Held:
    """Give the thread beside, which is held up."""
    thread = Held()

    class Whole(JointEstimate):
        def __init__(self, *given: Any, **named: Any) -> None:
            super().__init__(*given, **named)
            if threading.current_thread() is not threading.main_thread():
                thread.begun.set()
                thread.may_go_on.wait(WAIT_S)

    monkeypatch.setattr(explanation, "JointEstimate", Whole)
    return thread


def test_maps_are_made_in_time_while_all_pings_are_explained_together(
    pings: list[EchoCone], held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    fusion = fused(pings[:KNOWN])
    fusion.live_snapshot(in_time=True)()
    fuse(fusion, pings[KNOWN:20])
    before = fusion.live_snapshot(in_time=True)()
    thread = held.wait()
    for ping in pings[20:]:
        fusion.fuse(ping)
        fusion.live_snapshot(in_time=True)()
    meanwhile = fusion.live_snapshot(in_time=True)()
    assert thread.is_alive()
    assert np.count_nonzero(meanwhile.observed) > np.count_nonzero(before.observed)
    held.finish()
    # What has come meanwhile is taken up before, and what all say together is in the next map.
    expected = known(pings[:20])
    fuse(expected, pings[20:])
    monkeypatch.setattr(live_map, "MORE_SHARE", 10.0)
    late, same = fusion.live_snapshot(in_time=True)(), expected.live_snapshot()()
    assert_same(late, same)
    assert_same(fusion.occupancy_map(), fused(pings).occupancy_map())


def test_what_has_come_meanwhile_stays_on_maps_where_it_is_too_much_to_be_added(
    pings: list[EchoCone], held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All of it would take longer than the next pings take to come."""
    fusion = fused(pings[:KNOWN])
    fusion.live_snapshot(in_time=True)()
    fuse(fusion, pings[KNOWN:13])
    fusion.live_snapshot(in_time=True)()
    held.wait()
    for ping in pings[13:]:
        fusion.fuse(ping)
        fusion.live_snapshot(in_time=True)()
    meanwhile = fusion.live_snapshot(in_time=True)()
    monkeypatch.setattr(live_map, "MORE_SHARE", 10.0)
    held.finish()
    assert_same(fusion.live_snapshot(in_time=True)(), meanwhile)
    assert_same(fusion.occupancy_map(), fused(pings).occupancy_map())


def test_who_is_left_out_meanwhile_does_not_come_back(pings: list[EchoCone], held: Held) -> None:
    fusion = JointFusion(MappingParameters())
    for number, ping in enumerate(pings[:20]):
        fusion.fuse(ping, "odd" if number % 2 else "sound")
        if number == KNOWN:
            fusion.live_snapshot(in_time=True)()
    fusion.live_snapshot(in_time=True)()
    held.wait()
    fusion.leave_out(lambda source: source == "odd")
    held.finish()
    assert_same(fusion.live_snapshot(in_time=True)(), fused(pings[:20:2]).occupancy_map())


def test_who_is_trusted_less_is_so_in_a_later_map(pings: list[EchoCone], held: Held) -> None:
    fusion = JointFusion(MappingParameters())
    for number, ping in enumerate(pings[:20]):
        fusion.fuse(ping, "odd" if number % 2 else "sound")
    before = fusion.live_snapshot()()
    fusion.trust({"odd": 0.0})
    fusion.fuse(pings[20], "sound")
    meanwhile = fusion.live_snapshot(in_time=True)()
    held.wait()
    assert not fusion.is_whole
    assert np.count_nonzero(meanwhile.observed) >= np.count_nonzero(before.observed)
    held.finish()
    late = fusion.live_snapshot(in_time=True)()
    assert fusion.is_whole
    assert_same(late, fused(pings[:21:2]).occupancy_map())


def test_what_is_heard_where_nothing_is_known_is_in_a_later_map(
    pings: list[EchoCone], held: Held
) -> None:
    fusion = fused(pings[:20])
    before = fusion.live_snapshot()()
    far = replace(pings[0].pose, position_m=pings[0].pose.position_m + np.array([40.0, 0.0, 0.0]))
    fusion.fuse(replace(pings[0], pose=far, stamp_ns=100))
    meanwhile = fusion.live_snapshot(in_time=True)()
    assert meanwhile.geometry == before.geometry
    fusion.live_snapshot(in_time=True)()
    held.finish()
    late = fusion.live_snapshot(in_time=True)()
    assert fusion.is_whole
    assert_same(late, fusion.occupancy_map())
    assert late.geometry.shape[1] * 0.05 > 40.0


def test_many_that_begin_at_once_wait_for_the_first_of_them_alone(
    pings: list[EchoCone], held: Held, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("usmap_ros.mapping.joint.fusion.FIRST_PINGS", KNOWN)
    monkeypatch.setattr(live_map, "TOGETHER", 99)
    fusion = fused([])
    fusion.live_snapshot(in_time=True)()
    fuse(fusion, pings)
    meanwhile = fusion.live_snapshot(in_time=True)()
    held.wait()
    expected = known(pings[:KNOWN])
    fuse(expected, pings[KNOWN:])
    monkeypatch.setattr(live_map, "MORE_SHARE", 10.0)
    assert_same(meanwhile, expected.live_snapshot()())
    held.finish()
    assert_same(fusion.live_snapshot(in_time=True)(), fused(pings).occupancy_map())


def test_what_goes_wrong_beside_is_said_the_next_time(
    pings: list[EchoCone], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live_map, "FEW_PINGS", KNOWN)
    fusion = fused(pings[:KNOWN])
    fusion.live_snapshot(in_time=True)()
    fuse(fusion, pings[KNOWN:])

    def wrong(*given: Any, **named: Any) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(explanation, "JointEstimate", wrong)
    fusion.live_snapshot(in_time=True)()
    for thread in threading.enumerate():
        if thread.name == live_map.BESIDE:
            thread.join()
    with pytest.raises(ZeroDivisionError):
        fusion.live_snapshot(in_time=True)()


def added(one: np.ndarray, other: np.ndarray, is_asked: bool = True) -> np.ndarray:
    """Ratios of both in a row of cells."""
    both, row = one[np.newaxis].copy(), (1, len(one))
    add_overdispersed(both, other[np.newaxis], np.full(row, 2.5), np.full(row, is_asked))
    return both[0]


def test_silence_of_two_groups_says_no_more_than_their_sum() -> None:
    one, other = (np.random.default_rng(seed).uniform(-8.0, 2.0, (50, 3)).astype(np.float32)
                  for seed in (1, 2))  # fmt: skip
    both = added(one, other)
    np.testing.assert_allclose(both, added(other, one), rtol=1e-6)
    assert (both >= one + other - 1e-4).all()
    silent = (one < 0.0) & (other < 0.0)
    assert (both[silent] <= np.minimum(one, other)[silent] + 1e-4).all()
    np.testing.assert_array_equal(added(one, np.zeros_like(one)), one)
    np.testing.assert_array_equal(added(one, other, is_asked=False), one)
