"""What the paper's captions say, on the figures that take no time."""

import pytest

from usmap_ros.paper.choosing_cells import choosing_a_cell
from usmap_ros.paper.figure_1 import single_robot, two_robots
from usmap_ros.paper.figures_4_to_6 import four_paths, reconstruction, scene_and_pulse_train
from usmap_ros.paper.figures_7_8 import interference, two_matrices

PARTS = [
    single_robot,
    two_robots,
    scene_and_pulse_train,
    reconstruction,
    four_paths,
    interference,
    two_matrices,
    choosing_a_cell,
]


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.__name__)
def test_every_statement_of_the_caption_holds(part):
    caption = part().numbers["caption"]

    assert caption
    assert [words for words, one in caption.items() if one["holds"] is not True] == []


def test_exact_cells_and_residuals_of_whole_numbers():
    numbers = choosing_a_cell().numbers

    cells = {name: one["cells"] for name, one in numbers.items() if name != "caption"}
    assert cells == {
        "aligned, one object, not negative": 2,
        "aligned, one object, integer": 1,
        "aligned, one object, binary": 1,
        "aligned, two in mirrored cells, not negative": 2,
        "aligned, two in mirrored cells, integer": 1,
        "aligned, two in mirrored cells, binary": 2,
        "oblique, one object, not negative": 1,
        "oblique, one object, integer": 1,
        "oblique, one object, binary": 1,
        "oblique, two in mirrored cells, not negative": 2,
        "oblique, two in mirrored cells, integer": 2,
        "oblique, two in mirrored cells, binary": 2,
    }
    for name, one in numbers.items():
        if name != "caption":
            assert one["relative_residual"] < 1e-7, name
