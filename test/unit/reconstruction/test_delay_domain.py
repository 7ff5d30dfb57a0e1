"""The matrix-free operator against its own columns."""

import numpy as np
import pytest

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.reconstruction.delay_domain import DelayDomainOperator
from usmap_ros.reconstruction.template import Template

HANN = Template(0.0, 3.2e-4, Pulse(PulseShape.HANN_BURST, 50e3, 3.2e-4))
FLOOR = Channel(343.0, floor_height_m=0.5, floor_reflectivity=0.8)


def make(channel=None, start_delay_s=0.0, oversampling=4):
    return DelayDomainOperator(
        HANN,
        Sampling(25_000.0, start_delay_s, 300),
        channel or Channel(343.0),
        0.2,
        2.0,
        oversampling,
        1e-4,
    )


@pytest.fixture(params=["air", "floor", "late", "moved", "moved over a floor"])
def operator(request):
    channel = FLOOR if "floor" in request.param else None
    operator = make(channel, start_delay_s=0.002 if request.param == "late" else 0.0)
    if "moved" in request.param:
        operator = operator.moved(np.array([20, 150]), np.array([7e-6, -3e-6]))
    return operator


def test_dot_test(passes_dot_test, operator):
    assert passes_dot_test(operator, 0)


def test_columns_are_what_forward_makes_of_unit_vectors(operator):
    for block in (0, 20, 149, operator.block_count - 1):
        columns = operator.columns(np.array([block]))
        for path in range(operator.block_size):
            unit = np.zeros((operator.block_count, operator.block_size))
            unit[block, path] = 1.0
            np.testing.assert_allclose(operator.forward(unit), columns[:, path], atol=1e-12)


def test_scores_of_an_echo_are_highest_at_its_block(operator):
    block = 150
    expected = operator.channel.amplitudes(operator.block_ranges_m(np.array([block])))
    echo = operator.columns(np.array([block])) @ expected[0]
    scores = operator.scores(operator.adjoint(echo))

    if operator.block_size == 1:
        assert abs(int(np.argmax(scores)) - block) <= 1
        own = operator.echo_scores(np.array([block]), expected)
        np.testing.assert_allclose(scores[block], own[0], rtol=0.05)
    else:
        assert scores[block] > 0.9 * scores.max()


def test_blocks_lie_within_the_range_limits():
    ranges_m = make().ranges_m

    assert ranges_m[0] >= 0.2
    assert ranges_m[-1] <= 2.0 + 1e-9
    np.testing.assert_allclose(np.diff(ranges_m), 343.0 / 2.0 / 100_000.0)


def test_late_trace_starts_where_it_can_hear():
    operator = make(start_delay_s=0.004)
    direct = operator.columns(np.arange(operator.block_count))

    np.testing.assert_allclose(operator.delays_s(np.array([0]))[0, 0], 0.004, atol=HANN.duration_s)
    assert np.all(np.linalg.norm(direct, axis=0)[20:] > 0.5)


def test_excluded_band_holds_the_block_and_stays_inside():
    operator = make()
    for block in (0, 5, 100, operator.block_count - 1):
        band = np.arange(operator.block_count)[operator.excluded(block)]
        assert block in band
        assert np.abs(band - block).max() == 10


def test_rivals_over_a_floor_share_a_path():
    operator = make(FLOOR)
    rivals = set(operator.rivals(100))
    delays_s = operator.delays_s(np.arange(operator.block_count))
    apart_s = np.abs(delays_s[:, :, np.newaxis] - delays_s[100]).min(axis=(1, 2))

    assert rivals == set(np.flatnonzero(apart_s <= 1e-4 + 1e-9))
    assert len(rivals) > 21


def test_moving_a_block_moves_all_its_paths_and_leaves_the_original():
    operator = make(FLOOR)
    moved = operator.moved(np.array([50]), np.array([5e-6]))
    moved = moved.moved(np.array([50]), np.array([5e-6]))
    range_m = operator.ranges_m[50] + 343.0 / 2.0 * 1e-5

    np.testing.assert_allclose(moved.block_ranges_m(np.array([50])), range_m)
    np.testing.assert_allclose(moved.delays_s(np.array([50]))[0], FLOOR.delays_s(range_m))
    np.testing.assert_allclose(operator.block_ranges_m(np.array([50])), operator.ranges_m[50])


def test_slopes_are_the_derivatives_of_columns():
    operator = make(FLOOR).moved(np.array([60]), np.array([1e-6]))
    step_s, support = 1e-8, np.array([60])
    later = operator.moved(support, np.array([step_s])).columns(support)
    numeric = (later - operator.columns(support)) / step_s

    np.testing.assert_allclose(operator.slopes(support), numeric, atol=0.01 * np.abs(numeric).max())


def test_unit_norm_is_the_norm_of_the_echo_of_amplitude_one():
    operator = make(Channel(343.0))
    columns = operator.columns(np.arange(20, 60))

    np.testing.assert_allclose(operator.unit_norms[20:60], np.linalg.norm(columns, axis=0))
