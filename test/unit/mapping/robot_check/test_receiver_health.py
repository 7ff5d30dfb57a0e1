"""Receivers that are deaf, noisy or wrongly scaled are told from one another without a map."""

from typing import Any

import numpy as np
import pytest

from usmap_ros.mapping.robot_check.receiver_health import (
    ReceiverHealth,
    odd_receivers,
    receiver_health,
)
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.range_cones import RangeReading
from usmap_ros.reconstruction.reconstructor import reconstruct


def health(echoes: float, full: float, limit_db: float, loudness_db: float) -> ReceiverHealth:
    """Of a receiver whose echoes mask nothing."""
    return ReceiverHealth(echoes, full, limit_db, loudness_db, limit_db)


USUAL = [
    health(3.0, 0.1, -34.0, -25.0),
    health(2.4, 0.2, -33.0, -23.0),
    health(3.6, 0.1, -35.0, -27.0),
]
ODD = {
    "deaf by noise that is known": (health(0.2, 0.9, -5.0, -1.0), "deaf"),
    "deaf by a cover": (health(2.0, 0.2, -20.0, -24.0), "deaf"),
    "noise that nobody knows of": (health(32.0, 1.0, -13.0, -10.0), "noisy"),
    "too much gain": (health(2.8, 0.2, -14.0, -4.0), "loud"),
    "too little gain": (health(2.8, 0.2, -60.0, -50.0), "deaf"),
}


@pytest.mark.parametrize("case", ODD)
@pytest.mark.parametrize("others", [2, 3])
def test_the_odd_one_is_named(case: str, others: int) -> None:
    own, verdict = ODD[case]
    fleet = {f"/robot{number}/cone": usual for number, usual in enumerate(USUAL[:others])}

    found = odd_receivers({**fleet, "/odd/cone": own})

    assert {topic: finding.verdict for topic, finding in found.items()} == {"/odd/cone": verdict}
    assert "dB" in found["/odd/cone"].reason


def test_a_better_receiver_is_not_odd() -> None:
    quiet = health(4.0, 0.1, -50.0, -27.0)

    assert odd_receivers({"/1": USUAL[0], "/2": USUAL[1], "/3": quiet}) == {}


def test_several_are_named_one_after_the_other() -> None:
    odd = {"/deaf": ODD["deaf by noise that is known"][0], "/loud": ODD["too much gain"][0]}

    found = odd_receivers({**{f"/{n}": usual for n, usual in enumerate(USUAL)}, **odd})

    assert {topic: finding.verdict for topic, finding in found.items()} == {
        "/deaf": "deaf",
        "/loud": "loud",
    }


def test_of_two_only_noise_tells_which_is_odd() -> None:
    noisy = odd_receivers({"/1": USUAL[0], "/2": ODD["noise that nobody knows of"][0]})
    loud = odd_receivers({"/1": USUAL[0], "/2": ODD["too much gain"][0]})

    assert set(noisy) == {"/2"}
    assert {topic: found.verdict for topic, found in loud.items()} == {
        "/1": "contradicted",
        "/2": "contradicted",
    }
    assert not any(found.is_suspect for found in loud.values())
    assert "the only other" in loud["/1"].reason


def test_one_alone_is_not_judged() -> None:
    assert odd_receivers({"/1": ODD["too much gain"][0]}) == {}


def test_sensors_of_ranges_that_look_at_near_and_far_things_are_not_odd() -> None:
    """What is heard behind a reading's echo is nothing, which is no receiver's detection limit."""

    def health(range_m: float) -> ReceiverHealth | None:
        reading = RangeReading(0, "sonar", 0.5, 0.15, 5.0, range_m)
        return receiver_health([reading.cone(Pose.planar(0.0, 0.0, 0.0), "map")] * 20)

    healths = {f"/{range_m}": health(range_m) for range_m in (0.8, 4.0, np.inf)}

    assert odd_receivers({topic: own for topic, own in healths.items() if own}) == {}


def test_a_receiver_is_not_deaf_because_loud_echoes_mask_most_of_a_ping(hear: Any) -> None:
    """As walls do beside a robot, the more so the less is known of its pulse."""
    uncertain = ReconstructionParameters(model_error=0.4)

    def heard(ranges_m: FloatArray) -> ReceiverHealth | None:
        points = [(range_m, 0.0) for range_m in ranges_m]
        traces = [hear(points[nearest:], noise_std=0.002) for nearest in range(3)]
        return receiver_health([reconstruct(trace, uncertain).cone for trace in traces] * 5)

    hall = heard(np.array([2.8, 2.9, 3.0]))
    narrow = heard(np.arange(0.5, 4.0, 0.25))

    assert hall is not None
    assert narrow is not None
    assert odd_receivers({"/1": hall, "/2": hall, "/3": narrow}) == {}
