"""Matches from before frames were joined, as they lie since."""

import numpy as np
import pytest

from usmap_ros.localisation import Match
from usmap_ros.localisation.linked_frames import Link
from usmap_ros.localisation.planar import between, compose
from usmap_ros.runs.promising import EarlierMatch, Pair, joined_by

#: Where four frames are, and the middle of what stands in each.
FRAMES = {
    name: np.array(pose)
    for name, pose in {
        "a": (1.0, 2.0, 0.5), "b": (-2.0, 1.0, 2.0), "c": (0.5, -1.0, -1.0), "d": (3.0, 0.0, 3.0)
    }.items()
}  # fmt: skip
MIDDLE_M = np.array([4.0, -2.0])


def lies(one: str, other: str) -> np.ndarray:
    """Pose of the other frame in the first one."""
    return between(FRAMES[one], FRAMES[other])


def link(target: str, source: str) -> Link:
    """How these two frames lie."""
    return Link(target, source, lies(target, source), np.zeros(2))


def match(one: str, other: str, margin: float = 2.5) -> EarlierMatch:
    """Of two frames, promising by itself."""
    found = Match(lies(one, other), MIDDLE_M, 30.0, margin, 0.1, margin)
    return EarlierMatch((one, other), found, (), ())


@pytest.mark.parametrize(
    ("links", "pair"),
    [
        ([link("a", "b")], ("a", "c")),
        ([link("a", "b")], ("c", "a")),
        ([link("c", "d")], ("b", "c")),
        ([link("d", "c"), link("a", "b")], ("a", "d")),
        ([link("b", "d"), link("a", "b")], ("c", "a")),
    ],
)
def test_it_lies_as_before_in_the_frames_that_its_own_are_part_of(
    links: list[Link], pair: Pair
) -> None:
    (moved,) = joined_by([match("b", "c")], links)
    found = moved.promising(pair)
    assert found is not None
    np.testing.assert_allclose(found.change, lies(*pair), atol=1e-9)
    # The middle of the second frame's map, if that is c's, and of what is there of it otherwise.
    middle = between(FRAMES[pair[1]], compose(FRAMES["c"], np.append(MIDDLE_M, 0.0)))
    np.testing.assert_allclose(found.about_m, middle[:2], atol=1e-9)


def test_it_says_nothing_of_other_frames_nor_of_frames_that_are_one() -> None:
    assert match("b", "c").promising(("a", "c")) is None
    assert joined_by([match("b", "c")], [link("b", "c")]) == []


def test_it_must_have_been_promising() -> None:
    assert match("b", "c", margin=1.0).promising(("b", "c")) is None
