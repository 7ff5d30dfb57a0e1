"""Receivers that are dead, clipped or make echoes up are known by their echoes alone."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.robot_check.consistency import Consistency
from usmap_ros.mapping.robot_check.echo_health import (
    EchoHealth,
    echo_health,
    heard_louder,
    odd_echoes,
)
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters, ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation.points import hear

LOUD, FAR_M, WAY_M = 0.06, 4.0, 3.0


@pytest.fixture(scope="module")
def heard() -> EchoCone:
    """Give a ping with two echoes."""
    return reconstruct(hear([(1.5, 0.2), (2.5, -0.3)]), ReconstructionParameters()).cone


def drive(heard: EchoCone, most: float = np.inf, *, moves: bool = True) -> list[EchoCone]:
    """Give 40 pings on the way to one object, which no echo of is louder than `most`."""
    pings = []
    for way_m in np.linspace(0.0, WAY_M, 40):
        x_m = float(way_m) if moves else 0.0
        amplitude = min(0.5 / (FAR_M - x_m) ** 2, most)
        pings.append(
            replace(
                heard,
                pose=Pose.planar(x_m, 0.0, 0.0),
                ranges_m=np.array([FAR_M - x_m], np.float32),
                amplitudes=np.array([amplitude], np.float32),
            )
        )
    return pings


def health(pings: list[EchoCone]) -> EchoHealth:
    """Judge pings, of which there are some."""
    found = echo_health(pings)
    assert found is not None
    return found


def verdicts(own: EchoHealth, other: EchoHealth) -> dict[str, str]:
    """What is said of a robot and another one."""
    return {name: f.verdict for name, f in odd_echoes({"own": own, "other": other}).items()}


def test_one_that_clips_is_named(heard: EchoCone) -> None:
    assert verdicts(health(drive(heard, LOUD)), health(drive(heard))) == {"own": "clipped"}


@pytest.mark.parametrize(
    ("cut_off", "whole_db", "found"),
    [
        (0.2, -10.0, {"own": "clipped"}),
        (0.05, -10.0, {}),
        (0.2, -20.0, {}),
        (0.2, None, {}),
    ],
    ids=["below what others hear", "rarely", "at their full scale", "others know no louder ones"],
)
def test_one_that_cuts_off_what_others_hear_louder_is_named(
    cut_off: float, whole_db: float | None, found: dict[str, str]
) -> None:
    """However much its loudest echoes differ, as among walls that are far away."""
    own = EchoHealth(40, 0.0, 20.0, cut_off=cut_off, cut_off_db=-22.0, whole_db=-24.0)
    other = EchoHealth(40, 0.0, 20.0, whole_db=whole_db)
    assert verdicts(own, other) == found


def test_echoes_that_are_cut_off_are_counted(heard: EchoCone) -> None:
    pings = drive(heard)
    cut = [replace(p, amplitude_stds=p.amplitudes) for p in pings[:10]]
    whole = [replace(p, amplitude_stds=0.1 * p.amplitudes) for p in pings[10:]]
    own = health([*cut, *whole])
    assert own.cut_off == 0.25
    assert own.cut_off_db is not None
    assert own.whole_db is not None
    assert own.whole_db > own.cut_off_db


def test_one_that_is_parked_does_not_clip(heard: EchoCone) -> None:
    """Whatever it hears is always as loud."""
    parked = health(drive(heard, moves=False))
    assert parked.places == 1
    assert verdicts(parked, health(drive(heard))) == {}


def test_clipped_echoes_are_far_quieter_than_others_and_not_only_alike() -> None:
    """Of rough walls clipped ones vary by 5 dB; of mirrors those of a healthy robot do."""
    clipped = EchoHealth(40, 0.0, 20.0, loudest_db=-24.0, spread_db=5.0, faded_db=19.0)
    other = replace(clipped, loudest_db=1.0, spread_db=12.0)
    assert verdicts(clipped, other) == {"own": "clipped"}
    assert verdicts(replace(clipped, loudest_db=-2.0, spread_db=4.3), other) == {}


def test_who_hears_from_farther_away_is_quieter_for_that(heard: EchoCone) -> None:
    """In the middle of a room of mirrors all echoes may be alike, and fainter than at its walls."""

    def among(ranges_m: np.ndarray) -> EchoHealth:
        pings = [
            replace(ping, ranges_m=np.float32([range_m]), amplitudes=np.float32([0.5 / range_m]))
            for ping, range_m in zip(drive(heard), ranges_m, strict=True)
        ]
        return health(pings)

    at_walls = among(np.linspace(0.5, 1.5, 40))
    in_the_middle = replace(among(np.linspace(2.5, 3.5, 40)), spread_db=0.5)
    assert verdicts(in_the_middle, at_walls) == {}


def test_a_single_louder_echo_shows_that_nothing_clips(heard: EchoCone) -> None:
    """In the middle of a room a healthy robot's loudest echoes may be as alike, and as faint."""
    clipped = drive(heard, LOUD)
    near = replace(clipped[20], amplitudes=np.array([5.0 * LOUD], np.float32))
    healthy = health([*clipped[:20], near, *clipped[21:]])
    assert healthy.spread_db is not None
    assert healthy.spread_db < 1.0
    assert verdicts(health(clipped), health(drive(heard))) == {"own": "clipped"}
    assert verdicts(healthy, health(drive(heard))) == {}


def test_one_that_hears_nothing_anywhere_is_deaf(heard: EchoCone) -> None:
    nothing = np.empty(0, np.float32)
    silent = [replace(p, ranges_m=nothing, amplitudes=nothing) for p in drive(heard)]
    assert verdicts(health(silent), health(drive(heard))) == {"own": "deaf"}
    assert verdicts(health(silent[:10]), health(drive(heard))) == {}


def test_nobody_is_deaf_where_there_is_nothing(heard: EchoCone) -> None:
    silent = EchoHealth(places=40, silent=1.0, echoes=0.0)
    assert verdicts(silent, replace(silent, silent=0.9)) == {}


def test_one_that_makes_echoes_up_is_named() -> None:
    liar, other = (EchoHealth(places=40, silent=0.0, echoes=count) for count in (1000.0, 20.0))
    assert verdicts(liar, other) == {"own": "noisy"}


def test_a_robot_alone_is_not_judged(heard: EchoCone) -> None:
    assert odd_echoes({"own": health(drive(heard, LOUD))}) == {}
    assert echo_health([]) is None


def test_one_that_has_heard_far_louder_before_does_not_clip(heard: EchoCone) -> None:
    """Down a corridor loudest echoes are of walls beside, all alike, after one that was ahead."""
    quiet, loud = health(drive(heard, LOUD)), health(drive(heard))
    assert heard_louder(loud, quiet)
    assert not heard_louder(quiet, quiet)
    assert not heard_louder(quiet, loud)
    silent = EchoHealth(40, 1.0, 0.0)
    assert not heard_louder(silent, quiet)
    assert not heard_louder(quiet, silent)


@pytest.mark.parametrize(("before", "is_clipped"), [(np.inf, False), (LOUD, True)])
def test_nobody_is_said_to_clip_what_it_has_heard_louder(
    heard: EchoCone, before: float, is_clipped: bool
) -> None:
    consistency = Consistency(MappingParameters())
    whole = [np.inf] * 4
    ways = {"own": [before, before, LOUD, LOUD], "other": whole, "another": whole}
    for name, most in ways.items():
        pings = [ping for each in most for ping in drive(heard, each)]
        for number, ping in enumerate(pings):
            consistency.add(name, replace(ping, stamp_ns=number * 10**8))
    assert (consistency.findings()["own"].verdict == "clipped") == is_clipped
