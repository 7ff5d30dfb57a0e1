"""Robots that lie are named, and honest ones are not."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from robots_among_poles import cones, findings, traces

from usmap_ros.mapping.common_error import CommonError
from usmap_ros.mapping.joint.leave_one_out import LeaveOneOutMap
from usmap_ros.mapping.joint.witnesses import MutualEvidence
from usmap_ros.mapping.robot_check import displacement
from usmap_ros.mapping.robot_check.agreement import LEAST_PINGS, Agreement, agreement
from usmap_ros.mapping.robot_check.comparison import RobotComparison, finding_of
from usmap_ros.mapping.robot_check.consistency import Consistency, is_of
from usmap_ros.mapping.robot_check.displacement import Displacement, Robot
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.mapping.robot_check.sightings import sightings_of
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import MappingParameters, ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation import Scenario, simulate

LIAR = "/robot2/echo"


@cache
def in_a_room() -> list[tuple[str, EchoCone]]:
    """Give the cones of three robots in a room with poles."""
    walls = {"corners_m": [[0.0, 0.0], [5.0, 0.0], [5.0, 4.0], [0.0, 4.0]], "closed": True}
    motion = {"kind": "random_walk", "speed_m_s": 0.6, "clearance_m": 0.25}
    starts = ([1.0, 1.0, 0.0], [4.0, 1.0, 1.5], [2.5, 3.0, 3.0])
    content = {
        "seed": 1,
        "duration_s": 12.0,
        "world": {
            "area_m": [0.3, 4.7, 0.3, 3.7],
            "surface": {"specular_reflectivity": 0.2, "diffuse_reflectivity": 3.0},
            "walls": [walls],
            "points": [{"x_m": 1.7, "y_m": 1.9}, {"x_m": 3.4, "y_m": 2.3}],
        },
        "robots": [
            {"name": f"robot{number}", "motion": {**motion, "start": start}}
            for number, start in enumerate(starts, 1)
        ],
    }
    scenario = Scenario.from_mapping(content, "room")
    return [(t, reconstruct(p, ReconstructionParameters()).cone) for t, p in simulate(scenario)]


def of_samples(
    seed: int, factor: float, noise: float, *, is_stated: bool = False
) -> list[tuple[str, EchoCone]]:
    """Give cones of which the liar's samples are scaled, as may be stated, and have more noise."""
    rng = np.random.default_rng(seed)
    changed = []
    for (topic, trace), (_, cone) in zip(traces(seed), cones(seed), strict=True):
        heard = cone
        if topic == LIAR:
            more = noise * trace.noise_std * rng.standard_normal(len(trace.samples))
            samples = (factor * trace.samples + more).astype(np.float32)
            noise_std = trace.noise_std * (factor if is_stated else 1.0)
            changed_trace = replace(trace, samples=samples, noise_std=noise_std)
            heard = reconstruct(changed_trace, ReconstructionParameters()).cone
        changed.append((topic, heard))
    return changed


def displaced(
    cone: EchoCone, turned_rad: float, by_m: tuple[float, float] = (0.2, -0.25)
) -> EchoCone:
    """Say that a ping came from elsewhere."""
    x_m, y_m = cone.pose.position_m[:2] + np.array(by_m)
    return replace(cone, pose=Pose.planar(x_m, y_m, cone.pose.yaw_rad + turned_rad))


def named(found: dict[str, Finding]) -> dict[str, str]:
    """Verdicts on those that are suspected."""
    return {topic: finding.verdict for topic, finding in found.items() if finding.is_suspect}


@pytest.mark.parametrize("give", [lambda: cones(11), lambda: cones(12), in_a_room])
def test_honest_robots_are_not_suspected(give: Callable[[], list[tuple[str, EchoCone]]]) -> None:
    """And there is something to go by."""
    found = findings(give())

    assert named(found) == {}
    assert any(finding.verdict == "healthy" for finding in found.values())


def test_nobody_is_accused_where_hardly_anything_is_borne_out() -> None:
    """Of cells of 40 cm the others confirm a quarter, of whomever."""
    coarse = ReconstructionParameters.model_validate(
        {"dictionary": "cells", "cell_size_m": 0.4, "solver": "nnls"}
    )
    scenario = Scenario.load(Path(__file__).parents[4] / "config/scenarios/poles.yaml")
    found = findings([(t, reconstruct(trace, coarse).cone) for t, trace in simulate(scenario)])

    assert named(found) == {}


@pytest.mark.slow
def test_one_that_hears_too_little_is_named() -> None:
    """Its noise is as it was: it is the echoes that do not get through."""
    assert named(findings(of_samples(11, 0.05, 0.0))) == {LIAR: "deaf"}


@pytest.mark.parametrize(
    ("factor", "noise", "verdict"), [(1.0, 30.0, "noisy"), (10.0, 0.0, "loud")]
)
def test_one_whose_receiver_is_wrong_is_named_without_a_map(
    factor: float, noise: float, verdict: str
) -> None:
    consistency = Consistency(MappingParameters())
    for topic, cone in of_samples(11, factor, noise, is_stated=verdict == "loud"):
        consistency.add(topic, cone)

    assert named(consistency.findings()) == {LIAR: verdict}


@pytest.mark.parametrize(
    ("factor", "noise", "verdict"), [(1.0, 30.0, "noisy"), (10.0, 0.0, "loud")]
)
def test_one_whose_receiver_fails_on_the_way_is_named_soon(
    factor: float, noise: float, verdict: str
) -> None:
    """It was not until half of all pings that are remembered were wrong."""
    failed = of_samples(11, factor, noise, is_stated=verdict == "loud")
    consistency = Consistency(MappingParameters())
    for topic, cone in [*cones(11), *cones(11), *failed]:
        consistency.add(topic, cone)

    assert named(consistency.findings()) == {LIAR: verdict}


def test_one_that_repeats_itself_while_it_moves_is_named() -> None:
    first = next(cone for topic, cone in cones(11) if topic == LIAR and len(cone.ranges_m))
    pings = [
        (topic, replace(first, stamp_ns=cone.stamp_ns, pose=cone.pose) if topic == LIAR else cone)
        for topic, cone in cones(11)
    ]

    assert named(findings(pings)) == {LIAR: "stuck"}


def test_one_whom_nobody_bears_out_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is wrong with it."""
    monkeypatch.setattr("usmap_ros.mapping.robot_check.consistency.shifted", lambda *_: {})
    pings = [(topic, displaced(cone, 0.0) if topic == LIAR else cone) for topic, cone in cones(11)]

    found = findings(pings)

    assert named(found) == {LIAR: "misplaced"}
    assert found[LIAR].summary()["evidence"]["borne_out"] < 0.1


def test_one_of_whom_the_others_expect_nothing_is_not_accused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It looks into a room of its own, and what it denies of theirs is what reverberates."""
    monkeypatch.setattr("usmap_ros.mapping.robot_check.consistency.shifted", lambda *_: {})
    monkeypatch.setattr(
        "usmap_ros.mapping.robot_check.comparison.agreement",
        lambda expected: replace(agreement(expected), pings=LEAST_PINGS - 1, fit=None),
    )
    pings = [(topic, displaced(cone, 0.0) if topic == LIAR else cone) for topic, cone in cones(11)]

    assert named(findings(pings)) == {}


def test_no_map_accuses_one_whose_landmarks_others_hear(monkeypatch: pytest.MonkeyPatch) -> None:
    misplaced = Finding("misplaced", {}, "misplaced: by cells")
    monkeypatch.setattr(RobotComparison, "culprits", lambda *_: {LIAR: misplaced})

    assert named(findings(cones(1))) == {}


def test_one_that_is_elsewhere_is_named_with_how_far() -> None:
    """By others alone: its own echoes agree with one another."""
    by_m = (0.6, -0.45)
    pings = [
        (topic, displaced(cone, 0.0, by_m) if topic == LIAR else cone) for topic, cone in cones(11)
    ]

    found = findings(pings)

    assert named(found) == {LIAR: "misplaced"}
    evidence = found[LIAR].summary()["evidence"]
    assert [evidence["east_m"], evidence["north_m"]] == pytest.approx(by_m, abs=0.08)
    assert "0.8 m off" in found[LIAR].reason


@pytest.mark.parametrize("turned_rad", [0.35, -0.3, -1.4])
def test_one_that_faces_elsewhere_than_it_says_is_named_with_the_turn(turned_rad: float) -> None:
    """Nothing but its heading is wrong, and its beam is wide."""
    pings = [
        (topic, displaced(cone, turned_rad, (0.0, 0.0)) if topic == LIAR else cone)
        for topic, cone in cones(11)
    ]

    found = findings(pings)

    assert named(found) == {LIAR: "misplaced"}
    assert found[LIAR].summary()["evidence"]["turned_rad"] == pytest.approx(turned_rad, abs=0.1)
    assert "it faces" in found[LIAR].reason


def test_one_whose_ranges_are_too_long_is_named_with_how_much() -> None:
    """By a wrong speed of sound."""
    pings = [
        (topic, replace(cone, ranges_m=np.float32(1.05) * cone.ranges_m))
        if topic == LIAR
        else (topic, cone)
        for topic, cone in cones(12)
    ]

    found = findings(pings)

    assert named(found) == {LIAR: "misplaced"}
    assert "ranges are 5% too long" in found[LIAR].reason


def test_one_whose_poses_are_late_is_named_with_the_delay() -> None:
    own = [cone for topic, cone in cones(12) if topic == LIAR]
    late = iter([own[max(0, ping - 8)].pose for ping in range(len(own))])
    pings = [
        (topic, replace(cone, pose=next(late)) if topic == LIAR else cone)
        for topic, cone in cones(12)
    ]

    found = findings(pings)

    assert named(found) == {LIAR: "misplaced"}
    assert found[LIAR].summary()["evidence"]["late_s"] == pytest.approx(0.8, abs=0.1)
    assert "s late" in found[LIAR].reason


def test_nobody_is_accused_of_what_all_have_in_common() -> None:
    """Maybe all mounts are stated by another convention."""
    pings = [(topic, displaced(cone, 0.5, (0.0, 0.0))) for topic, cone in cones(11)]

    assert named(findings(pings)) == {}


def test_of_two_the_one_whose_own_echoes_do_not_meet_is_named() -> None:
    pings = [
        (topic, displaced(cone, -1.4, (0.0, 0.0)) if topic == LIAR else cone)
        for topic, cone in cones(11)
        if topic != "/robot3/echo"
    ]

    assert named(findings(pings)) == {LIAR: "misplaced"}


@pytest.mark.slow
@pytest.mark.parametrize(("turned_rad", "stands"), [(0.0, False), (0.35, True)])
def test_a_turn_that_others_contradict_is_no_fault(
    turned_rad: float, *, stands: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However well a robot's own echoes meet with its heading turned."""
    heard: dict[str, list[EchoCone]] = {}
    for topic, cone in cones(1):
        is_turned = topic == LIAR
        heard.setdefault(topic, []).append(
            displaced(cone, turned_rad, (0.0, 0.0)) if is_turned else cone
        )
    robots = {}
    for topic, own in heard.items():
        sightings = sightings_of(own)
        assert sightings is not None
        robots[topic] = Robot(own, sightings)

    def by_itself(robot: Robot) -> Displacement | None:
        is_liar = robot is robots[LIAR]
        return Displacement("turned", (0.35,), 35.0, 60.0) if is_liar else None

    monkeypatch.setattr(Robot, "displacement", by_itself)
    assert bool(displacement.displaced(robots)) is stands


@pytest.mark.parametrize(("by_m", "turned_rad"), [((0.2, -0.25), 0.0), ((0.0, 0.0), 0.35)])
def test_one_that_is_misplaced_in_a_room_is_named(
    by_m: tuple[float, float], turned_rad: float
) -> None:
    """Walls are everywhere, and what it adds to the map spoils what the others are judged by."""
    pings = [
        (topic, displaced(cone, turned_rad, by_m) if topic == LIAR else cone)
        for topic, cone in in_a_room()
    ]
    assert named(findings(pings)) == {LIAR: "misplaced"}


@pytest.mark.parametrize("by_m", [(0.2, -0.25), (0.6, -0.45)])
def test_of_two_that_contradict_each_other_nobody_is_accused(by_m: tuple[float, float]) -> None:
    pings = [
        (topic, displaced(cone, 0.0, by_m) if topic == LIAR else cone)
        for topic, cone in cones(11)
        if topic != "/robot3/echo"
    ]

    found = findings(pings)

    assert named(found) == {}
    assert {finding.verdict for finding in found.values()} == {"contradicted"}
    assert "or /robot1/echo is misplaced" in found[LIAR].reason


@pytest.mark.parametrize(
    ("of_its_own", "verdicts"),
    [((0.9, 0.9), {"contradicted"}), ((0.3, 0.3), {"healthy"}), ((0.3, 0.95), {"contradicted"})],
)
def test_of_two_that_contradict_themselves_alike_nobody_is_suspected(
    monkeypatch: pytest.MonkeyPatch, of_its_own: tuple[float, float], verdicts: set[str]
) -> None:
    """Surfaces that answer irregularly contradict everybody, each robot's own other half too."""
    share = np.array([[of_its_own[0], 0.3], [0.3, of_its_own[1]]])
    said = MutualEvidence(100.0 * share, 100.0 * (1.0 - share))
    monkeypatch.setattr(LeaveOneOutMap, "mutual_evidence", lambda *_: said)
    monkeypatch.setattr("usmap_ros.mapping.robot_check.consistency.shifted", lambda *_: {})
    pings = [
        (topic, displaced(cone, 0.0) if topic == LIAR else cone)
        for topic, cone in cones(11)
        if topic != "/robot3/echo"
    ]

    assert {finding.verdict for finding in findings(pings).values()} == verdicts


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_nobody_is_accused_by_what_is_said_of_a_few_cells(
    monkeypatch: pytest.MonkeyPatch, times: float
) -> None:
    """Of three healthy robots among smooth walls, one struck other walls squarely than the rest."""
    agreed = [[54.9, 2.8, 127.3], [2.8, 144.4, 0.0], [127.3, 0.0, 55.5]]
    contradicted = [[0.0, 87.8, 6.4], [87.8, 17.7, 52.6], [6.4, 52.6, 4.0]]
    said = MutualEvidence(times * np.array(agreed), times * np.array(contradicted))
    monkeypatch.setattr(LeaveOneOutMap, "mutual_evidence", lambda _: said)
    own = {t: [cone for topic, cone in cones(11) if topic == t] for t in dict(cones(11))}
    comparison = RobotComparison(MappingParameters(), own)

    found = comparison.culprits(comparison.screen())

    assert named(found) == ({} if times == 1.0 else {LIAR: "misplaced"})


@pytest.mark.slow
def test_nobody_faces_elsewhere_by_a_few_smooth_walls() -> None:
    """All of the latest pings together fit them better turned, and no part of them does."""
    root = Path(__file__).parents[4]
    motion = {"kind": "random_walk", "speed_m_s": 0.6, "clearance_m": 0.25}
    surface = {
        "specular_reflectivity": 0.5, "diffuse_reflectivity": 0.3, "scatterers_per_m": 20.0
    }  # fmt: skip
    sonar = {"receiver": {"noise_std": 0.01}}
    content = {
        "seed": 916,
        "duration_s": 10.0,
        "world": {"map": {"path": str(root / "config/maps/flat.yaml"), "surface": surface}},
        "medium": {"temperature_c": 20.0, "relative_humidity": 0.5},
        "robots": [
            {"name": f"robot{number}", "motion": motion, "transducers": [sonar]}
            for number in (1, 2, 3)
        ],
    }
    scenario = Scenario.from_mapping(content, "flat")
    pings = [(t, reconstruct(p, ReconstructionParameters()).cone) for t, p in simulate(scenario)]

    assert named(findings(pings)) == {}


def test_one_that_pings_rarely_and_faces_elsewhere_is_named() -> None:
    """No third of its way has echoes enough that meet by themselves."""
    content = {
        "seed": 7,
        "duration_s": 120.0,
        "world": {
            "area_m": [0.0, 10.0, 0.0, 10.0],
            "random_poles": {"count": 30, "separation_m": 0.6},
        },
        "robots": [{"name": f"robot{number}", "ping_rate_hz": 0.5} for number in (1, 2, 3)],
    }
    pings = []
    for topic, trace in simulate(Scenario.from_mapping(content, "rare")):
        cone = reconstruct(trace, ReconstructionParameters()).cone
        is_turned = topic == LIAR
        pings.append((topic, displaced(cone, 0.35, (0.0, 0.0)) if is_turned else cone))

    found = findings(pings)

    assert named(found) == {LIAR: "misplaced"}
    assert found[LIAR].summary()["evidence"]["turned_rad"] == pytest.approx(0.35, abs=0.05)


def test_a_robot_alone_is_not_judged() -> None:
    found = findings([(topic, cone) for topic, cone in cones(11) if topic == LIAR])

    assert {finding.verdict for finding in found.values()} == {"unknown"}


def test_names_stand_for_topics_and_robots() -> None:
    assert is_of("/robot2/left/echo", ["robot2"])
    assert is_of("/robot2/left/echo", ["/robot2/left/echo"])
    assert is_of("/robot2/left/echo", ["robot1", "/robot2/left"])
    assert not is_of("/robot21/echo", ["robot2"])
    assert not is_of("/robot2/echo", ["", "/"])


#: Of one robot among smooth walls, and of its fellows.
SMOOTH = Agreement(
    pings=12, echoes=4.0, audible=22, heard=17, matches=17, loudness_db=-6.6, fit=0.85
)
OTHERS = [
    replace(SMOOTH, pings=14, heard=22, loudness_db=3.8, fit=2.2),
    replace(SMOOTH, pings=9, heard=20, loudness_db=7.8, fit=2.2),
]
CHANGES = {
    "healthy": {},
    "unknown": {"pings": 7},
    "deaf": {"loudness_db": -20.0},
    "loud": {"loudness_db": 30.0},
    "misplaced": {"fit": 0.1, "heard": 3, "matches": 3},
}


@pytest.mark.parametrize("verdict", CHANGES)
def test_smooth_walls_do_not_make_a_robot_suspect(verdict: str) -> None:
    """They are struck squarely by one robot and not by another, whose echoes are fainter then."""
    own = replace(SMOOTH, **CHANGES[verdict])

    assert finding_of(own, OTHERS, least_fit=0.4).verdict == verdict


def test_one_that_hears_what_is_expected_is_here_whatever_it_hears_besides() -> None:
    """Where walls reverberate, that is most."""
    own = replace(SMOOTH, audible=19, heard=19, fit=0.1)

    assert finding_of(own, OTHERS, least_fit=0.4).verdict == "healthy"
    assert finding_of(replace(own, heard=12), OTHERS, least_fit=0.4).verdict == "misplaced"


def test_a_few_loud_echoes_do_not_make_a_robot_loud() -> None:
    """They may be of a wall that others struck askew."""
    own = replace(SMOOTH, matches=8, loudness_db=24.0)

    assert finding_of(own, OTHERS, least_fit=0.4).verdict == "healthy"
    assert finding_of(replace(own, matches=12), OTHERS, least_fit=0.4).verdict == "loud"


def test_one_that_hears_nothing_is_deaf_and_not_misplaced() -> None:
    own = replace(SMOOTH, echoes=0.3, heard=1, matches=1, loudness_db=None, fit=0.0)

    found = finding_of(own, OTHERS, least_fit=0.4)

    assert found.verdict == "deaf"
    assert "1 of 22 expected echoes" in found.reason


def test_nobody_is_accused_whom_the_others_bear_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though its pings may fit the others' map badly, as those that hear little of it do."""
    chosen = {t: [cone for topic, cone in cones(11) if topic == t] for t in dict(cones(11))}
    comparison = RobotComparison(MappingParameters(), chosen)
    screened = comparison.screen()
    suspected = Finding("misplaced", {}, "misplaced: its pings fit badly")

    monkeypatch.setattr(
        comparison, "_misplaced", lambda suspects: dict.fromkeys(suspects, suspected)
    )

    assert comparison.culprits(screened | {LIAR: suspected}) == {}


@pytest.mark.parametrize("is_mended", [False, True])
def test_a_robot_is_judged_by_its_latest_pings(
    monkeypatch: pytest.MonkeyPatch, is_mended: bool
) -> None:
    """What it said before bears witness as if another had: for it, or against it."""
    for name in ("LATEST", "EARLIER"):
        monkeypatch.setattr(f"usmap_ros.mapping.robot_check.consistency.{name}", 20)
    begin_ns = cones(12)[0][1].stamp_ns
    pings = [
        (topic, displaced(cone, -1.4, (0.0, 0.0)) if is_wrong and topic == LIAR else cone)
        for topic, cone in cones(12)
        for is_wrong in [(cone.stamp_ns - begin_ns < 3e9) == is_mended]
    ]

    assert named(findings(pings)) == ({} if is_mended else {LIAR: "misplaced"})


@pytest.mark.parametrize(("seed", "times"), [(1, 0.97), (3, 1.03)])
def test_nobody_is_to_blame_for_what_is_wrong_with_all(seed: int, times: float) -> None:
    """Of robots that all take sound for too fast, the one that showed it most was accused."""

    def accused(is_corrected: bool) -> list[str]:
        consistency = Consistency(MappingParameters(correct_common_errors=is_corrected))
        for topic, cone in cones(seed):
            told_m = cone.ranges_m * np.float32(times)
            consistency.add(topic, replace(cone, ranges_m=told_m))
        return [topic for topic, found in consistency.findings().items() if found.is_suspect]

    assert accused(is_corrected=True) == []
    assert len(accused(is_corrected=False)) == 1


def test_ranges_of_all_are_corrected_only_if_landmarks_are_clearer_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In a smooth room they seemed 1.3 % too short, and a healthy robot was accused for that."""
    expected = findings(cones(1))
    monkeypatch.setattr(
        "usmap_ros.mapping.robot_check.consistency.common_error",
        lambda *_: CommonError(scale=1.013),
    )

    assert findings(cones(1)) == expected
