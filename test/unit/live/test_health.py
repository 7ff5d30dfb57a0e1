"""Levels, figures and findings of a node, with a clock that the tests set."""

from typing import Any

import pytest

from usmap_ros.live.health import Health, Level, Remark


@pytest.fixture
def warnings() -> list[str]:
    """Give the list that first occurrences of problems go into."""
    return []


@pytest.fixture
def health(clock: Any, warnings: list[str]) -> Health:
    """Give the health of a node that has done nothing yet."""
    return Health(("received", "malformed"), warnings.append, clock)


def test_without_problems_all_is_well(health: Health) -> None:
    report = health.report()
    assert (report.level, report.message) == (Level.OK, "all is well")
    assert report.facts == {"received": "0", "malformed": "0", "rate (Hz)": "0.0"}


def test_a_problem_shows_for_some_seconds_and_its_reason_for_ever(
    health: Health, clock: Any
) -> None:
    health.problem("malformed", "samples: are missing")
    report = health.report()
    assert (report.level, report.message) == (Level.WARN, "malformed: samples: are missing")
    clock.pass_time(6.0)
    report = health.report()
    assert (report.level, report.message) == (Level.OK, "all is well")
    assert report.facts["malformed"] == "1"
    assert report.facts["last malformed"] == "samples: are missing"


def test_the_worst_finding_makes_the_level(health: Health) -> None:
    health.problem("malformed", "samples: are missing")
    health.problem("failed", "ZeroDivisionError()", is_error=True)
    report = health.report()
    assert report.level == Level.ERROR
    assert report.message == "malformed: samples: are missing; failed: ZeroDivisionError()"


def test_only_the_first_occurrence_is_logged(health: Health, warnings: list[str]) -> None:
    for _ in range(3):
        health.problem("malformed", "samples: are missing")
    assert warnings == ["malformed: samples: are missing (further ones in /diagnostics)"]


def test_the_rate_is_that_of_the_last_seconds(health: Health, clock: Any) -> None:
    for _ in range(40):
        clock.pass_time(0.25)
        health.work("received")
    assert health.report().facts["rate (Hz)"] == "4.0"
    clock.pass_time(6.0)
    assert health.report().facts["rate (Hz)"] == "0.0"


def test_a_flood_has_its_true_rate(health: Health, clock: Any) -> None:
    for _ in range(1500):
        clock.pass_time(0.002)
        health.work("received")
    assert float(health.report().facts["rate (Hz)"]) == pytest.approx(500.0, rel=0.01)


def test_slow_messages_are_a_warning_until_they_are_quick_again(health: Health, clock: Any) -> None:
    health.watch(lambda: health.slowness(1.0))
    for _ in range(10):
        health.latency(8.0)
    report = health.report()
    assert report.level == Level.WARN
    assert report.message == "slow: messages take 8.0 s, more than 1 s"
    assert report.facts["latency p50 (ms)"] == "8000.0"
    clock.pass_time(6.0)
    health.latency(0.1)
    assert health.report().level == Level.OK


def test_silence_is_a_warning(health: Health, clock: Any) -> None:
    health.watch(lambda: health.silence("no trace has come"))
    clock.pass_time(9.0)
    assert health.report().level == Level.OK
    health.work("received")
    clock.pass_time(9.0)
    assert health.report().level == Level.OK
    clock.pass_time(3.0)
    report = health.report()
    assert (report.level, report.message) == (Level.WARN, "silent for 12 s: no trace has come")


def test_what_is_told_is_a_figure(health: Health) -> None:
    health.tell("listeners", lambda: 2)
    assert health.report().facts["listeners"] == "2"


def test_what_is_watched_is_asked_for_each_report(health: Health) -> None:
    findings: list[Remark | None] = [Remark(Level.ERROR, "is not configured"), None]
    health.watch(lambda: findings.pop(0))
    assert health.report().level == Level.ERROR
    assert health.report().level == Level.OK


def test_what_is_found_is_logged_when_it_begins(
    health: Health, clock: Any, warnings: list[str]
) -> None:
    health.watch(lambda: health.silence("no trace has come"))
    for _ in range(3):
        clock.pass_time(11.0)
        health.report()
    assert warnings == ["silent for 11 s: no trace has come"]
    health.work("received")
    health.report()
    clock.pass_time(20.0)
    health.report()
    assert warnings[1:] == ["silent for 20 s: no trace has come"]
