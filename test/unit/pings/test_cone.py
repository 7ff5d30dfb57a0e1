"""What a cone says, and which cones cannot be."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_pings import CONE

from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import LIMIT_STEP_DB, EchoCone, encode_limits


@pytest.fixture
def cone() -> EchoCone:
    return CONE


@given(st.lists(st.floats(1e-5, 10.0**1.375), min_size=1))
def test_limits_are_rounded_up_by_less_than_a_step(amplitudes: list[float]) -> None:
    codes = encode_limits(np.array(amplitudes))
    assert codes.dtype == np.uint8
    decoded_db = -100.0 + LIMIT_STEP_DB * codes.astype(float)
    excess_db = decoded_db - 20.0 * np.log10(amplitudes)
    assert excess_db.min() > -1e-6
    assert excess_db.max() < LIMIT_STEP_DB


def test_limits_beyond_the_scale_are_its_ends() -> None:
    assert encode_limits(np.array([0.0, 1e-9, 1e9])).tolist() == [0, 0, 255]


def test_limits_are_read_as_amplitudes(cone: EchoCone) -> None:
    limits = replace(cone, detection_limits=np.array([0, 120, 200], dtype=np.uint8))
    np.testing.assert_allclose(limits.limit_amplitudes(), [1e-5, 1e-2, 1.0])


def test_a_possible_cone_is_valid_with_and_without_echoes(cone: EchoCone) -> None:
    cone.validate()
    nothing = np.zeros(0, dtype=np.float32)
    replace(
        cone, ranges_m=nothing, range_stds_m=nothing, amplitudes=nothing, amplitude_stds=nothing
    ).validate()


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"frame_id": ""}, r"header\.frame_id"),
        ({"pose": Pose.planar(np.nan, 0.0, 0.0)}, r"pose\.position"),
        ({"attenuation_db_m": -1.0}, "attenuation"),
        ({"attenuation_db_m": np.inf}, "attenuation"),
        ({"amplitudes": np.ones(3, dtype=np.float32)}, "amplitudes"),
        ({"ranges_m": np.array([1.0, np.nan], dtype=np.float32)}, "ranges"),
        ({"range_stds_m": np.array([1.0, -0.1], dtype=np.float32)}, "range_stds"),
        ({"amplitude_stds": np.array([np.inf, 0.1], dtype=np.float32)}, "amplitude_stds"),
        ({"ranges_m": np.array([2.0, 1.0], dtype=np.float32)}, "ranges: do not ascend"),
        ({"detection_limits": np.zeros(0, dtype=np.uint8)}, "detection_limits: is empty"),
        ({"limit_step_m": 0.0}, "limit_step"),
        ({"limit_step_m": np.nan}, "limit_step"),
    ],
)
def test_an_impossible_cone_is_refused_by_the_field_to_blame(
    cone: EchoCone, change: dict[str, object], field: str
) -> None:
    with pytest.raises(MalformedMessageError, match=field):
        replace(cone, **change).validate()
