"""The paper's sensing matrix against the simulator."""

import numpy as np
import pytest

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.numerics.geometry import Pose
from usmap_ros.reconstruction.cell_dictionary import (
    CellDictionary,
    CellSound,
    ConeCells,
    cell_signal,
)
from usmap_ros.reconstruction.matrix_operator import identical

FLOOR = Channel(343.0, 1.5, floor_height_m=0.6, floor_reflectivity=0.7)
AT_EDGE = Pose.planar(0.0, 0.25, 0.0)


def test_cells_are_those_in_the_cone_by_ascending_range(hear):
    pose = Pose.planar(1.3, -2.1, 2.5)
    cells = ConeCells.seen(pose, hear([]).transducer, 0.1)

    assert np.all(np.diff(cells.ranges_m) >= 0.0)
    offset = cells.centers_m - pose.position_m[:2]
    np.testing.assert_allclose(np.hypot(*offset.T), cells.ranges_m)
    np.testing.assert_allclose(
        offset,
        cells.ranges_m[:, np.newaxis]
        * np.stack([np.cos(2.5 + cells.bearings_rad), np.sin(2.5 + cells.bearings_rad)], axis=-1),
        atol=1e-12,
    )
    # As many cells as the cone's area holds.
    area_m2 = np.deg2rad(40.0) * (5.0**2 - 0.2**2)
    assert len(cells) == pytest.approx(area_m2 / 0.01, rel=0.02)
    assert cells.ranges_m[0] >= 0.2
    assert cells.ranges_m[-1] <= 5.0


@pytest.mark.parametrize("reception", ["iq", "raw", "square", "tone_iq"])
@pytest.mark.parametrize("channel", [Channel(343.0), FLOOR])
@pytest.mark.parametrize("start_delay_s", [0.0, 0.004])
def test_column_is_the_trace_of_an_ideal_object_at_the_centre(
    hear, reception, channel, start_delay_s
):
    hearing = {"reception": reception, "channel": channel, "start_delay_s": start_delay_s}
    dictionary = CellDictionary.for_trace(hear([], pose=AT_EDGE, **hearing), 0.5)
    for number in (0, len(dictionary.cells) // 2, len(dictionary.cells) - 1):
        center_m = dictionary.cells.centers_m[number]
        trace = hear([center_m], pose=AT_EDGE, **hearing)
        column = dictionary.columns(np.array([number]))[:, 0]
        np.testing.assert_allclose(column, cell_signal(trace)[0], atol=1e-6 * column.max())


def test_envelope_column_is_the_envelope_of_one_object(hear):
    dictionary = CellDictionary.for_trace(hear([], reception="envelope"), 0.5)
    trace = hear([dictionary.cells.centers_m[7]], reception="envelope")
    column = dictionary.columns(np.array([7]))[:, 0]
    np.testing.assert_allclose(column, cell_signal(trace)[0], atol=1e-6)


def test_envelope_signal_has_noise_of_mean_zero(hear):
    trace = hear([], reception="envelope", noise_std=0.1)
    signal, noise_std = cell_signal(trace)

    assert abs(signal.mean()) < 3.0 * noise_std / np.sqrt(len(signal))
    assert signal.std() == pytest.approx(noise_std, rel=0.1)


def test_stated_noise_is_that_of_the_signal(hear):
    for reception in ("iq", "raw", "square"):
        signal, noise_std = cell_signal(hear([], reception=reception, noise_std=0.1))
        assert signal.std() == pytest.approx(noise_std, rel=0.1)


def test_sparse_and_dense_are_the_same(hear):
    trace = hear([], channel=FLOOR)
    dense = CellDictionary.for_trace(trace, 0.5)
    stored = CellDictionary.for_trace(trace, 0.5, as_sparse=True)

    np.testing.assert_array_equal(stored.matrix.toarray(), dense.matrix)
    assert stored.matrix.nnz < 0.2 * dense.matrix.size


def test_simple_dictionary_leaves_the_floor_out(hear):
    with_floor, without = hear([], channel=FLOOR), hear([], channel=Channel(343.0, 1.5))
    simple = CellDictionary.for_trace(with_floor, 0.5, floor=False)
    expected = CellDictionary.for_trace(without, 0.5)
    rows = expected.sample_count

    np.testing.assert_array_equal(simple.matrix[:rows], expected.matrix)


def test_mirrored_cells_are_identical_unless_the_sensor_is_oblique(hear):
    def alike(pose):
        dictionary = CellDictionary.for_trace(hear([], pose=pose), 0.5)
        labels = identical(dictionary, np.random.default_rng(0))
        return dictionary, labels, np.count_nonzero(np.bincount(labels)[labels] > 1)

    dictionary, labels, count = alike(AT_EDGE)
    off_axis = np.abs(dictionary.cells.bearings_rad) > 1e-9
    assert count == np.count_nonzero(off_axis)
    for label in np.unique(labels[off_axis]):
        left, right = dictionary.cells.bearings_rad[labels == label]
        assert left == pytest.approx(-right)
    assert alike(Pose.planar(0.05, 0.21, 0.3))[2] == 0


def test_cell_beyond_what_was_heard_has_a_column_of_zeros(hear):
    trace = hear([], max_range_m=2.0)
    far = hear([], max_range_m=5.0).transducer
    cells = ConeCells.seen(trace.pose, far, 0.5)
    dictionary = CellDictionary(
        cells,
        [CellSound.of(trace, trace.sent[0], cells, trace.channel)],
        trace.channel,
        trace.sampling,
        trace.encoding,
    )
    assert np.all(dictionary.norms[cells.ranges_m < 1.9] > 0.0)
    assert np.all(dictionary.norms[cells.ranges_m > 2.2] == 0.0)
