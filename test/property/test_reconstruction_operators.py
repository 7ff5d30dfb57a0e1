"""The dictionary of cells, whatever the pulse, the walls and the sampling."""

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


@QUICK
@given(cell_dictionaries(), seeds)
def test_scores_are_the_products_with_unit_columns(dictionary, seed):
    signal = np.random.default_rng(seed).normal(size=dictionary.sample_count)
    columns = dictionary.columns(np.arange(dictionary.block_count))
    norms = np.linalg.norm(columns, axis=0)

    np.testing.assert_allclose(dictionary.norms, norms, atol=1e-12)
    np.testing.assert_allclose(
        dictionary.scores(dictionary.adjoint(signal)) * norms, np.abs(columns.T @ signal), atol=1e-9
    )
