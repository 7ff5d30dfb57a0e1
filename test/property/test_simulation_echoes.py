"""What holds for every scene: symmetries, superposition, shadows."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import Encoding
from usmap_ros.simulation import EchoSimulator, MountedTransducer
from usmap_ros.simulation.motion import RandomWalk, RandomWalkModel
from usmap_ros.simulation.receiver import Converter, Receiver
from usmap_ros.simulation.scene import Discs, Scene
from usmap_ros.simulation.surfaces import Surface, WallSegments, scatter_along

PULSE = Pulse(PulseShape.HANN_BURST, 50_000.0, 0.00032)
SURFACE = Surface(specular_reflectivity=0.5, diffuse_reflectivity=2.0, scatterers_per_m=30.0)
HOME = Pose.planar(0.0, 0.0, 0.0)

# Polar, so that most of them are in the cone.
placed = st.tuples(st.floats(0.3, 4.8), st.floats(-0.8, 0.8), st.floats(0.1, 2.0))
objects = st.lists(placed, min_size=1, max_size=6)
corners = st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0))
segments = st.lists(
    st.tuples(corners, corners).filter(lambda ends: np.hypot(*np.subtract(*ends)) > 0.1),
    min_size=1,
    max_size=5,
)


def discs_of(items, radius=0.0):
    distance, bearing, reflectivity = np.array(items).T
    centers = np.stack([distance * np.cos(bearing), distance * np.sin(bearing)], axis=-1)
    return Discs(centers, np.full(len(items), radius), reflectivity)


def walls_of(items):
    starts, ends = np.array(items).transpose(1, 0, 2)
    return WallSegments.between(starts, ends, SURFACE, one_sided=False)


def scene_of(discs, walls=None, moved=lambda positions: positions):
    """Scene whose discs, walls and scatterers are drawn first and then moved."""
    walls = WallSegments.joined([]) if walls is None else walls
    scatterers = scatter_along(walls, SURFACE, np.random.default_rng(0))
    return Scene(
        Discs(moved(discs.centers_m), discs.radii_m, discs.reflectivities),
        WallSegments(moved(walls.starts_m), moved(walls.ends_m), *_sides(walls)),
        type(scatterers)(
            moved(scatterers.positions_m), scatterers.reflectivities, scatterers.walls
        ),
    )


def _sides(walls):
    return walls.one_sided, walls.specular_reflectivity


def ping(scene, pose=HOME, encoding=Encoding.IQ, rate=25_000.0, floor=0.0):
    channel = Channel(343.0, 1.0, 0.5 if floor else 0.0, floor)
    sonar = MountedTransducer(
        topic="/robot1/echo",
        child_frame_id="robot1/sonar",
        mount=HOME,
        transducer=Transducer(PULSE, BeamPattern.linear(), 0.2, 5.0),
        receiver=Receiver(encoding, rate, 0.0, 0.0),
        channel=channel,
        stated_channel=channel,
        stated_noise_std=0.0,
        pose_stds=np.zeros(3),
    )
    trace = EchoSimulator(scene).ping(sonar, pose, 0, np.random.default_rng(0))
    return trace.signal()


@given(objects, objects, st.sampled_from([0.0, 0.6]))
def test_points_add_up(some, others, floor):
    both = ping(scene_of(discs_of(some + others)), floor=floor)
    apart = [ping(scene_of(discs_of(part)), floor=floor) for part in (some, others)]
    np.testing.assert_allclose(both, sum(apart), atol=1e-4)


@given(objects, st.floats(0.1, 5.0))
def test_echoes_scale_with_reflectivity(items, factor):
    scaled = [(distance, bearing, factor * strength) for distance, bearing, strength in items]
    np.testing.assert_allclose(
        ping(scene_of(discs_of(scaled))), factor * ping(scene_of(discs_of(items))), atol=1e-3
    )


@given(st.integers(0, 2**32 - 1))
def test_the_mirrored_scene_sounds_the_same(seed):
    # Random, for on round numbers a line of sight may graze the end of a wall.
    rng = np.random.default_rng(seed)
    items = rng.uniform([0.3, -0.8, 0.1], [4.8, 0.8, 2.0], (6, 3))
    ends = rng.uniform(-4.0, 4.0, (4, 2, 2))
    discs, walls = discs_of(items, radius=0.1), walls_of(ends)
    mirrored = scene_of(discs, walls, moved=lambda positions: positions * [1.0, -1.0])
    np.testing.assert_allclose(ping(mirrored), ping(scene_of(discs, walls)), atol=1e-4)


@given(st.integers(0, 2**32 - 1), corners, st.floats(-np.pi, np.pi))
def test_only_where_things_are_relative_to_the_transducer_counts(seed, shift, turn):
    # Random, for on round numbers a line of sight may graze the end of a wall.
    rng = np.random.default_rng(seed)
    items = rng.uniform([0.3, -0.8, 0.1], [4.8, 0.8, 2.0], (6, 3))
    ends = rng.uniform(-4.0, 4.0, (4, 2, 2))
    cosine, sine = np.cos(turn), np.sin(turn)
    rotation = np.array([[cosine, sine], [-sine, cosine]])
    discs, walls = discs_of(items, radius=0.1), walls_of(ends)
    moved = scene_of(discs, walls, moved=lambda positions: positions @ rotation + shift)
    there = ping(moved, Pose.planar(*shift, turn))
    np.testing.assert_allclose(there, ping(scene_of(discs, walls)), atol=1e-4)


@given(st.floats(0.5, 4.5), st.integers(1, 20))
def test_half_a_wavelength_farther_has_the_same_phase(distance, halves):
    wavelength = 343.0 / 50_000.0
    near, far = (
        ping(scene_of(discs_of([(d, 0.0, 1.0)])))
        for d in (distance, distance + halves * wavelength / 2.0)
    )
    turn = np.angle(near[np.argmax(np.abs(near))] / far[np.argmax(np.abs(far))])
    assert turn == pytest.approx(0.0, abs=1e-3)


@given(objects)
def test_raw_mixed_down_is_iq(items):
    scene, rate = scene_of(discs_of(items)), 500_000.0
    raw = ping(scene, encoding=Encoding.RAW, rate=rate)
    baseband = ping(scene, rate=rate)
    time = np.arange(len(raw)) / rate
    spectrum = np.fft.fft(raw * np.exp(-2j * np.pi * 50_000.0 * time))
    spectrum[np.abs(np.fft.fftfreq(len(raw), 1.0 / rate)) > 50_000.0] = 0.0
    mixed = 2j * np.fft.ifft(spectrum)
    assert np.linalg.norm(mixed - baseband) <= 1e-3 * np.linalg.norm(baseband) + 1e-9


@given(objects, segments)
def test_walls_only_take_away(items, ends):
    silent = Surface(specular_reflectivity=0.0, diffuse_reflectivity=0.0)
    open_scene = scene_of(discs_of(items))
    starts, stops = np.array(ends).transpose(1, 0, 2)
    walls = WallSegments.between(starts, stops, silent, one_sided=False)
    walled = Scene(open_scene.discs, walls, open_scene.scatterers)
    # Each object is heard as in the open, or not at all.
    for index in range(len(items)):
        part = discs_of([items[index]])
        alone = ping(Scene(part, open_scene.walls, open_scene.scatterers))
        behind = ping(Scene(part, walls, open_scene.scatterers))
        assert not behind.any() or np.array_equal(behind, alone)
    assert np.linalg.norm(ping(walled)) <= sum(
        np.linalg.norm(ping(scene_of(discs_of([item])))) for item in items
    ) * (1.0 + 1e-6)


@settings(max_examples=20)
@given(segments, st.integers(0, 2**32 - 1))
def test_no_random_walk_goes_through_a_wall(ends, seed):
    scene = scene_of(discs_of([(2.0, 0.5, 1.0)], radius=0.3), walls_of(ends))
    area = (-6.0, 6.0, -6.0, 6.0)
    model = RandomWalkModel(speed_m_s=1.0, turn_std_rad=0.5, clearance_m=0.15)
    walk = RandomWalk(model, scene, area, None, np.random.default_rng(seed))
    track = [walk.pose(0.05 * step).position_m[:2] for step in range(200)]
    for start, end in itertools.pairwise(track):
        assert scene.clearance_m(start, end) >= 0.15 - 1e-9


@given(
    st.integers(2, 16),
    st.floats(0.1, 10.0),
    st.lists(st.floats(-20.0, 20.0), min_size=2, max_size=20),
    st.booleans(),
)
def test_converters_keep_order_and_change_nothing_twice(bits, full_scale, values, signed):
    converter = Converter(bits=bits, full_scale=full_scale)
    once = converter.convert(np.sort(values), signed=signed)
    assert np.all(np.diff(once) >= 0.0)
    assert np.abs(once).max() <= full_scale
    np.testing.assert_array_equal(converter.convert(once, signed=signed), once)
