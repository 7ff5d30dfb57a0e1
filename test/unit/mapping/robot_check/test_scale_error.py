"""Whose ranges are too long, by what is gained at other scales."""

from dataclasses import replace

import numpy as np
import pytest

from usmap_ros.mapping.robot_check.displacement import Robot, scale_error
from usmap_ros.mapping.robot_check.sightings import sightings_of
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation.points import hear

POLES_M = np.array([(1.6, 0.5), (2.0, -0.4), (2.6, 0.2)])


@pytest.mark.parametrize(
    ("scale", "own", "theirs", "background", "error"),
    [
        (0.9675, 23.2, 2.5, 1.13, None),
        (0.9525, 13.3, 2.3, 0.71, None),
        (0.95, 24.9, 3.0, 1.105, 1.0 / 0.95 - 1.0),
        (0.955, 5.7, 14.9, 0.77, 1.0 / 0.955 - 1.0),
        (0.955, -5.7, 34.9, 0.77, None),
        (0.925, 36.2, 0.0, 1.16, None),
        (0.91, 60.0, 0.0, 1.16, 1.0 / 0.91 - 1.0),
        (1.025, 19.7, 2.9, 0.63, None),
        (1.05, 60.0, 0.0, 0.63, 1.0 / 1.05 - 1.0),
    ],
    ids=[
        "healthy among rough walls",
        "healthy among smooth walls",
        "5 % too long among rough walls",
        "5 % too long among smooth walls",
        "by what others hear alone",
        "healthy with poses that are off",
        "10 % too long",
        "round columns answer from in front",
        "too short",
    ],
)
def test_ranges_are_wrong_if_enough_is_gained_for_what_is_unexplained(
    scale: float, own: float, theirs: float, background: float, error: float | None
) -> None:
    """Healthy ones are those that gained most of 1,600, the others of those that gained least."""
    found = scale_error(scale, np.array([own, theirs]), background, 0.0)

    assert (found and found[0]) == pytest.approx(error)


def test_ranges_that_are_best_as_told_are_not_wrong() -> None:
    """What landmarks are found varies by chance, and with them which scale is best at last."""
    assert scale_error(1.0, np.array([60.0, 0.0]), 0.63, 100.0) is None


@pytest.mark.parametrize(
    ("scale", "gain", "told", "is_wrong"),
    [
        (0.9575, 41.2, 356.0, False),
        (0.9475, 28.5, 274.0, False),
        (0.9225, 54.7, 201.0, False),
        (0.9475, 38.0, 232.0, True),
        (0.95, 26.9, 176.0, True),
    ],
    ids=["healthy", "healthy", "healthy, and odd", "5 % too long", "5 % too long"],
)
def test_ranges_are_not_wrong_by_little_of_all_that_chance_explains(
    scale: float, gain: float, told: float, is_wrong: bool
) -> None:
    """Robots that look ahead hear as much from walls that reverberate as from landmarks."""
    found = scale_error(scale, np.array([gain, 0.0]), 1.2, told)

    assert (found is not None) == is_wrong


def passing(factor: float, error_m: float) -> list[EchoCone]:
    """Give twelve pings on the way past three poles, whose ranges and places are off."""
    heard = reconstruct(hear([(1.5, 0.2), (2.5, -0.3)]), ReconstructionParameters()).cone
    rng, pings = np.random.default_rng(3), []
    for part in np.linspace(-0.5, 0.5, 12):
        x_m, y_m = 1.2 * part, part**2
        ranges_m = factor * np.sort(np.hypot(*(POLES_M - (x_m, y_m)).T))
        off_m = rng.normal(0.0, error_m, 2)
        pings.append(
            replace(
                heard,
                pose=Pose.planar(x_m + off_m[0], y_m + off_m[1], 0.0),
                ranges_m=ranges_m.astype(np.float32),
                range_stds_m=np.full(3, 1e-3, np.float32),
                amplitudes=(0.3 / ranges_m**2).astype(np.float32),
                amplitude_stds=np.full(3, 1e-3, np.float32),
            )
        )
    return pings


@pytest.mark.parametrize(
    ("factor", "error_m", "is_sure"), [(1.0, 0.0, False), (1.05, 0.0, True), (1.05, 0.06, False)]
)
def test_the_more_exact_poses_are_the_fewer_pings_tell_of_ranges(
    factor: float, error_m: float, *, is_sure: bool
) -> None:
    """A wrong speed of sound was found in half of the rooms, as if all poses were off by 3 cm."""
    cones = passing(factor, error_m)
    heard = sightings_of(cones)
    assert heard is not None

    wrong = Robot(cones, heard).scaling([])

    assert (wrong is not None) == is_sure
    if wrong:
        assert wrong.error[0] == pytest.approx(factor - 1.0, abs=0.004)
