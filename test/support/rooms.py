"""Small rooms with a closed outline, and pings in them, drawn by Hypothesis."""

import numpy as np
from hypothesis import strategies as st

from usmap_ros.grids import GridGeometry
from usmap_ros.pings.fields_of_view import PingViews

SHAPE = (24, 30)
GEOMETRY = GridGeometry(0.05, (-0.4, 1.0), SHAPE)
AROUND = np.ones((3, 3), dtype=bool)


@st.composite
def truths(draw: st.DrawFn) -> np.ndarray:
    """Rooms with a closed outline and straight pieces of wall anywhere."""
    occupied = np.zeros(SHAPE, dtype=bool)
    occupied[[2, -3], 2:-2] = True
    occupied[2:-2, [2, -3]] = True
    for _ in range(draw(st.integers(0, 5))):
        row, column = draw(st.integers(3, SHAPE[0] - 4)), draw(st.integers(3, SHAPE[1] - 4))
        length = draw(st.integers(1, 10))
        if draw(st.booleans()):
            occupied[row : min(row + length, SHAPE[0] - 3), column] = True
        else:
            occupied[row, column : min(column + length, SHAPE[1] - 3)] = True
    return occupied


@st.composite
def all_views(draw: st.DrawFn) -> PingViews:
    """One to four pings from inside the outline."""
    x = st.floats(GEOMETRY.origin_m[0] + 0.2, GEOMETRY.extent_m[1] - 0.2)
    y = st.floats(GEOMETRY.origin_m[1] + 0.2, GEOMETRY.extent_m[3] - 0.2)
    beam = st.tuples(st.floats(-4.0, 4.0), st.floats(0.1, np.pi), st.floats(0.1, 2.0))
    pings = draw(st.lists(st.tuples(x, y, beam), min_size=1, max_size=4))
    return PingViews(
        np.array([(x_m, y_m) for x_m, y_m, _ in pings]), np.array([beam for _, _, beam in pings])
    )
