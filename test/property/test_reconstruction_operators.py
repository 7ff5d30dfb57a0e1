"""Both sensing operators are linear operators with the adjoint they claim."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.images import Mirrors
from usmap_ros.acoustics.legs import straight_legs, wall_legs
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.sampling import Sampling
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import Encoding
from usmap_ros.reconstruction.cell_dictionary import CellDictionary, CellSound
from usmap_ros.reconstruction.cone_cells import ConeCells
from usmap_ros.reconstruction.delay_domain import DelayDomainOperator
from usmap_ros.reconstruction.joint import JointOperator
from usmap_ros.reconstruction.template import Template

QUICK = settings(max_examples=40)

channels = st.builds(
    Channel,
    sound_speed_m_s=st.floats(300.0, 360.0),
    attenuation_db_m=st.floats(0.0, 3.0),
    floor_height_m=st.sampled_from([0.0, 0.1, 0.7]),
    floor_reflectivity=st.floats(0.0, 1.0),
)
durations_s = st.floats(1e-4, 8e-4)
pulses = st.one_of(
    st.builds(Pulse, st.sampled_from(PulseShape), st.just(40e3), durations_s),
    st.builds(Pulse, st.just(PulseShape.CHIRP), st.just(40e3), durations_s, st.floats(-15e3, 15e3)),
)
samplings = st.builds(
    Sampling,
    sample_rate_hz=st.floats(15e3, 40e3),
    start_delay_s=st.floats(0.0, 0.01),
    sample_count=st.integers(1, 300),
)
seeds = st.integers(0, 2**32 - 1)


@st.composite
def delay_operators(draw):
    pulse = draw(pulses)
    operator = DelayDomainOperator(
        Template(0.0, pulse.duration_s, pulse),
        draw(samplings),
        draw(channels),
        draw(st.floats(0.0, 0.5)),
        draw(st.floats(0.6, 2.0)),
        draw(st.integers(1, 5)),
        draw(st.floats(1e-5, 3e-4)),
    )
    count = draw(st.integers(0, min(3, operator.block_count)))
    if count:
        moved = draw(
            st.lists(
                st.integers(0, operator.block_count - 1),
                min_size=count,
                max_size=count,
                unique=True,
            )
        )
        steps = draw(st.lists(st.floats(-2e-5, 2e-5), min_size=count, max_size=count))
        operator = operator.moved(np.array(moved), np.array(steps))
    return operator


@st.composite
def cell_dictionaries(draw):
    pose = Pose.planar(
        draw(st.floats(-5.0, 5.0)), draw(st.floats(-5.0, 5.0)), draw(st.floats(-4.0, 4.0))
    )
    pulse = draw(pulses)
    transducer = Transducer(pulse, BeamPattern.linear(), 0.1, 1.5)
    cells = ConeCells.seen(pose, transducer, draw(st.floats(0.1, 0.5)))
    channel = draw(channels)
    legs = straight_legs(pose, transducer.beam, channel, cells.points_m)
    # Some with a wall in the cone, so that they have legs by way of it.
    wall = Mirrors(np.array([[-3.0, -4.0]]), np.array([[3.5, 4.0]]), np.array([0.5]))
    if draw(st.booleans()):
        legs = legs.beside(wall_legs(pose, transducer.beam, channel, cells.points_m, wall))
    sent = [pulse, *draw(st.lists(pulses, max_size=1))]
    return CellDictionary(
        cells,
        [CellSound(one, legs, legs, 40e3) for one in sent],
        channel,
        draw(samplings),
        draw(st.sampled_from(Encoding)),
        as_sparse=draw(st.booleans()),
    )


@st.composite
def joint_operators(draw):
    sampling, channel = draw(samplings), draw(channels)
    return JointOperator(
        [
            DelayDomainOperator(
                Template(0.0, pulse.duration_s, pulse, None, 40e3 + draw(st.floats(-5e3, 5e3))),
                sampling,
                channel,
                0.1,
                1.5,
                3,
                1e-4,
            )
            for pulse in draw(st.lists(pulses, min_size=2, max_size=3))
        ]
    )


@QUICK
@given(joint_operators(), seeds)
def test_joint_operator_passes_the_dot_test(passes_dot_test, operator, seed):
    assert passes_dot_test(operator, seed)


@QUICK
@given(delay_operators(), seeds)
def test_delay_domain_passes_the_dot_test(passes_dot_test, operator, seed):
    assert passes_dot_test(operator, seed)


@QUICK
@given(cell_dictionaries(), seeds)
def test_cell_dictionary_passes_the_dot_test(passes_dot_test, dictionary, seed):
    assert passes_dot_test(dictionary, seed)


@QUICK
@given(st.one_of(delay_operators(), joint_operators(), cell_dictionaries()), seeds)
def test_columns_are_what_forward_makes_of_them(operator, seed):
    generator = np.random.default_rng(seed)
    count = min(5, operator.block_count)
    support = np.sort(generator.choice(operator.block_count, count, replace=False))
    values = generator.normal(size=(count, operator.block_size))
    coefficients = np.zeros((operator.block_count, operator.block_size))
    coefficients[support] = values

    expected = operator.columns(support) @ values.reshape(-1)
    scale = np.abs(expected).max(initial=0.0) or 1.0
    np.testing.assert_allclose(
        operator.forward(coefficients), expected, rtol=0, atol=1e-9 * scale + 1e-12
    )


@QUICK
@given(st.one_of(delay_operators(), joint_operators(), cell_dictionaries()), seeds)
def test_operators_are_linear(operator, seed):
    generator = np.random.default_rng(seed)
    shape = (2, operator.block_count, operator.block_size)
    x, y = generator.normal(size=shape)
    together = operator.forward(2.0 * x - 3.0 * y)

    apart = 2.0 * operator.forward(x) - 3.0 * operator.forward(y)
    np.testing.assert_allclose(together, apart, atol=1e-9 * (1.0 + np.abs(apart).max(initial=0.0)))
