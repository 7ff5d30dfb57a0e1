"""One ping cannot tell a pole from its mirror image; those of several robots can."""

from collections.abc import Callable

import numpy as np
import pytest

from usmap_ros.grids import OCCUPIED_PROBABILITY

SCENES = 100


def test_with_two_robots_the_true_cells_rank_first(look_at_poles: Callable) -> None:
    """Of k poles, each of the k most probable cells more than two apart is within one of a pole."""
    right = 0
    for seed in range(SCENES):
        sighting = look_at_poles(2, seed)
        right += bool(sighting.are_right(sighting.best(len(sighting.true_cells))).all())
    print(f"{right} of {SCENES} scenes")
    assert right >= 0.95 * SCENES


@pytest.mark.parametrize(
    ("robots", "least_found", "most_ghost_scenes"), [(3, 0.98, 1), (4, 0.99, 0)]
)
def test_with_more_robots_the_poles_are_certain_and_mirror_images_are_not(
    look_at_poles: Callable, robots: int, least_found: float, most_ghost_scenes: int
) -> None:
    """A ghost is a cell of 0.65 or more that is not within one cell of a pole's."""
    found, ghost_scenes = [], 0
    for seed in range(SCENES):
        sighting = look_at_poles(robots, seed)
        certain = sighting.cells[sighting.probability >= OCCUPIED_PROBABILITY]
        found.extend(sighting.are_found(certain))
        ghost_scenes += not sighting.are_right(certain).all()
    print(f"{np.mean(found):.3f} of {len(found)} poles, ghosts in {ghost_scenes} scenes")
    assert ghost_scenes <= most_ghost_scenes
    assert np.mean(found) >= least_found
