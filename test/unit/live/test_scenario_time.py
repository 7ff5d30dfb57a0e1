"""Scenario time goes on, whatever the clock does."""

import pytest

from usmap_ros.live.scenario_time import NoTimeError, ScenarioTime

SECOND = 1_000_000_000
EPOCH = 1_700_000_000 * SECOND


@pytest.mark.parametrize("first_ns", [SECOND // 10, 3600 * SECOND, EPOCH])
def test_a_scenario_begins_with_the_first_reading(first_ns: int) -> None:
    time = ScenarioTime()
    assert time.at(first_ns) == 0.0
    assert time.at(first_ns + 2 * SECOND) == 2.0
    assert time.start_ns == first_ns


def test_a_clock_that_has_not_started_is_no_time() -> None:
    time = ScenarioTime()
    with pytest.raises(NoTimeError, match="/clock"):
        time.at(0)
    assert time.at(EPOCH) == 0.0


def test_a_scenario_goes_on_from_where_it_was_when_the_clock_jumps_ahead() -> None:
    time = ScenarioTime()
    time.at(5 * SECOND)
    time.at(8 * SECOND)
    assert time.at(EPOCH) == 3.0
    assert time.at(EPOCH + SECOND) == 4.0


def test_a_scenario_begins_anew_when_the_clock_is_set_to_before_its_start() -> None:
    time = ScenarioTime()
    time.at(EPOCH)
    assert time.at(3 * SECOND) == 0.0
    assert time.at(4 * SECOND) == 1.0


def test_a_clock_that_is_set_back_a_little_leads_back_on_the_path() -> None:
    time = ScenarioTime()
    time.at(EPOCH)
    time.at(EPOCH + 20 * SECOND)
    assert time.at(EPOCH + 12 * SECOND) == 12.0


def test_a_clock_that_stands_still_makes_time_stand_still() -> None:
    time = ScenarioTime()
    time.at(EPOCH)
    assert [time.at(EPOCH + SECOND) for _ in range(3)] == [1.0, 1.0, 1.0]


def test_a_start_that_is_given_holds_for_all_robots_whatever_the_clock_does() -> None:
    time = ScenarioTime(EPOCH)
    assert time.at(EPOCH - 3 * SECOND) == -3.0
    assert time.at(EPOCH + 1000 * SECOND) == 1000.0
    assert time.at(EPOCH + SECOND) == 1.0
    with pytest.raises(NoTimeError, match=r"start_time_s: is 1\.7e\+09 s ago"):
        ScenarioTime(SECOND).at(EPOCH)
