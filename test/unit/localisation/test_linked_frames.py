"""Frames that several matches link."""

import numpy as np
import pytest

from usmap_ros.localisation import Match
from usmap_ros.localisation.linked_frames import links
from usmap_ros.localisation.planar import between, compose

#: Where frames are.
REAL = {
    "map": np.array([0.0, 0.0, 0.0]),
    "a/odom": np.array([1.0, 2.0, 0.5]),
    "b/odom": np.array([-3.0, 1.0, 2.0]),
    "c/odom": np.array([0.5, -4.0, -1.2]),
}
RANKED = list(REAL)


def match(
    one: str, other: str, margin: float, off: tuple[float, float, float] = (0, 0, 0)
) -> Match:
    """How a frame lies in another one; by how much it is off at the centre of the second map."""
    about = np.array([2.0, 1.0, 0.0])
    there = compose(compose(between(REAL[one], REAL[other]), about), np.array(off))
    return Match(compose(there, between(about, np.zeros(3))), about[:2], 50.0, margin, 0.0)


def placed(sure: dict[tuple[str, str], Match]) -> dict[str, tuple[str, np.ndarray]]:
    """The frame that each frame is brought into, and where it is there."""
    found = {name: (name, np.zeros(3)) for name in RANKED}
    for link in links(sure, RANKED, lambda name: name.endswith("/odom")):
        for name, (frame, pose) in list(found.items()):
            if frame == link.source:
                found[name] = link.target, compose(link.change, pose)
    return found


@pytest.mark.parametrize(
    "pairs",
    [
        [("a/odom", "b/odom"), ("b/odom", "c/odom")],
        [("b/odom", "c/odom"), ("a/odom", "b/odom")],
        [("a/odom", "c/odom"), ("b/odom", "c/odom")],
        [("a/odom", "c/odom"), ("b/odom", "c/odom"), ("a/odom", "b/odom")],
    ],
)
def test_frames_that_matches_link_come_into_the_first_one(pairs: list[tuple[str, str]]) -> None:
    sure = {pair: match(*pair, margin=9.0 - number) for number, pair in enumerate(pairs)}
    found = placed(sure)
    for name in ("b/odom", "c/odom"):
        assert found[name][0] == "a/odom"
        np.testing.assert_allclose(found[name][1], between(REAL["a/odom"], REAL[name]), atol=1e-9)


def test_what_a_match_is_off_it_is_off_at_the_same_place_whichever_frame_stays() -> None:
    # c comes into a first, so b, which stays before c, is brought along the other way round.
    sure = {
        ("a/odom", "c/odom"): match("a/odom", "c/odom", 9.0),
        ("b/odom", "c/odom"): match("b/odom", "c/odom", 8.0),
    }
    last = links(sure, RANKED, lambda name: True)[-1]
    assert (last.target, last.source) == ("a/odom", "b/odom")
    about = np.append(last.about_m, 0.0)
    centre = compose(REAL["c/odom"], np.array([2.0, 1.0, 0.0]))
    np.testing.assert_allclose(compose(REAL["b/odom"], about)[:2], centre[:2], atol=1e-9)


@pytest.mark.parametrize(
    ("off", "is_linked"),
    [((0.3, 0.2, 0.1), True), ((3.0, 0.0, 0.0), False), ((0.0, 0.0, np.pi), False)],
)
def test_matches_that_contradict_each_other_link_nobody(
    off: tuple[float, float, float], is_linked: bool
) -> None:
    pairs = [("a/odom", "b/odom"), ("b/odom", "c/odom"), ("a/odom", "c/odom")]
    sure = {pair: match(*pair, margin=9.0) for pair in pairs[:2]}
    sure[pairs[2]] = match(*pairs[2], margin=4.0, off=off)
    found = placed(sure)
    assert (found["b/odom"][0] == found["c/odom"][0] == "a/odom") == is_linked


def test_frames_that_robots_share_are_not_moved() -> None:
    sure = {("map", "a/odom"): match("map", "a/odom", 5.0)}
    assert placed(sure)["a/odom"][0] == "map"
    assert not links(sure, RANKED, lambda name: False)
