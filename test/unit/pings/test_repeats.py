"""The same ping counts once, offline too."""

from dataclasses import replace

import pytest

from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.repeats import RepeatedPingError, SeenPings
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.simulation import Scenario, simulate


@pytest.fixture(scope="module")
def cones(request: pytest.FixtureRequest) -> list[EchoCone]:
    """Give twelve cones of three robots."""
    scenario = Scenario.load(request.config.rootpath / "config/scenarios/poles.yaml")
    pipeline, pings = Pipeline(), simulate(scenario)
    return [pipeline.reconstruct(next(pings)[1]) for _ in range(12)]


def test_a_ping_is_new_once_in_whatever_order(cones: list[EchoCone]) -> None:
    seen = SeenPings()
    for cone in (*cones[6:], *cones[:6]):
        seen.add(cone)
    for cone in cones:
        with pytest.raises(RepeatedPingError, match=f"earlier ping of '{cone.child_frame_id}'"):
            seen.add(replace(cone, residual=0.5))


def test_transducers_that_ping_at_one_instant_are_told_apart(cones: list[EchoCone]) -> None:
    cone, pulse = cones[0], cones[0].transducer.pulse
    other_pulse = replace(cone.transducer, pulse=replace(pulse, carrier_hz=31e3))
    seen = SeenPings()
    for different in (
        cone,
        replace(cone, child_frame_id="robot9/sonar"),
        replace(cone, pose=Pose.planar(1.0, 2.0, 3.0)),
        replace(cone, transducer=other_pulse),
        replace(cone, stamp_ns=cone.stamp_ns + 1),
    ):
        seen.add(different)


def test_memory_has_a_bound(cones: list[EchoCone], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("usmap_ros.pings.repeats._PINGS", 8)
    monkeypatch.setattr("usmap_ros.pings.repeats._TRANSDUCERS", 2)
    seen = SeenPings()
    for robot in range(5):
        for number in range(30):
            seen.add(replace(cones[0], child_frame_id=f"r{robot}", stamp_ns=number))
    with pytest.raises(RepeatedPingError):
        seen.add(replace(cones[0], child_frame_id="r4", stamp_ns=29))
    # Of the last two transducers eight at most are known still, and nothing of the others.
    seen.add(replace(cones[0], child_frame_id="r4", stamp_ns=21))
    seen.add(replace(cones[0], child_frame_id="r0", stamp_ns=29))
