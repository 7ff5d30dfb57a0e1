"""Bearings come back from the distances that they make, wherever transducers are and point."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.numerics.geometry import Pose
from usmap_ros.reconstruction.bearings import Sighting, Viewpoint, bearings_of, find_bearings
from usmap_ros.reconstruction.cones import RecoveredEchoes

QUICK = settings(max_examples=60, deadline=None)
BEAM = BeamPattern.linear()
NO_TURN = np.array([0.0, 0.0, 0.0, 1.0])

angles = st.floats(-0.3, 0.3)
#: Up to two parts of the baseline of at least 3 cm to the left: it lies across the beam.
offsets = st.floats(-0.01, 0.01)


def echoes(ranges_m, amplitudes):
    stds_m = np.full(len(ranges_m), 1e-3)
    return RecoveredEchoes(np.asarray(ranges_m), stds_m, amplitudes, 0.05 * amplitudes)


@QUICK
@given(
    left=st.floats(0.03, 0.3),
    offset=st.tuples(offsets, offsets),
    turn=st.tuples(st.floats(-3.0, 3.0), angles, angles),
    rise=st.floats(-0.5, 0.5),
    bearing=st.floats(-0.35, 0.35),
    ground=st.floats(0.8, 4.0),
    shares=st.booleans(),
)
def test_a_bearing_is_the_one_that_made_the_distances(
    left, offset, turn, rise, bearing, ground, shares
):
    pose = Pose(np.array([1.0, -2.0, 0.7]), Rotation.from_euler("ZYX", turn).as_quat())
    mount = Pose(np.array([offset[0], left, offset[1]]), NO_TURN)
    azimuth = pose.yaw_rad + bearing
    offset_m = np.array([ground * np.cos(azimuth), ground * np.sin(azimuth), rise])
    point = pose.position_m + offset_m
    range_m, off_axis = pose.polar(point)
    other_m, _ = pose.compose(mount).polar(point)
    assume(abs(off_axis) < 0.9 * BEAM.half_angle_rad)
    half_m = np.array([0.5 * (range_m + other_m) if shares else other_m])

    sighting = Sighting(mount, BEAM, shares, echoes(half_m, np.ones(1)))
    view = Viewpoint.of(pose, BEAM, rise)
    found = bearings_of(np.array([range_m]), half_m, view, sighting)

    np.testing.assert_allclose(found, [bearing], atol=1e-6)


@QUICK
@given(st.lists(st.floats(-0.5, 0.5), min_size=1, max_size=5), st.integers(0, 1000))
def test_objects_that_are_apart_are_all_paired(bearings, seed):
    bearings = np.array(bearings)
    ranges_m = 1.0 + 0.5 * np.arange(len(bearings))
    left_m = ranges_m * np.sin(bearings) - 0.1
    ahead_m = ranges_m * np.cos(bearings)
    others_m, seen_at = np.hypot(ahead_m, left_m), np.arctan2(left_m, ahead_m)
    order = np.random.default_rng(seed).permutation(len(bearings))
    others = echoes(others_m[order], (BEAM.gain(seen_at) / others_m**2)[order])
    mount = Pose(np.array([0.0, 0.1, 0.0]), NO_TURN)

    found, stds = find_bearings(
        echoes(ranges_m, BEAM.gain(bearings) / ranges_m**2),
        Viewpoint.of(Pose.planar(0.0, 0.0, 0.0), BEAM, 0.0),
        [Sighting(mount, BEAM, False, others)],
    )

    np.testing.assert_allclose(found, bearings, atol=1e-6)
    # A difference of ranges known to √2 mm, over 10 cm across the way there.
    np.testing.assert_allclose(stds, np.hypot(1e-3, 1e-3) / (0.1 * np.cos(bearings)), rtol=0.15)
