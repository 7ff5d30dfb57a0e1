"""Whose ranges are too long, by what is gained at other scales."""

import pytest

from usmap_ros.mapping.robot_check.displacement import SCALES, scale_error

#: Log-likelihoods of healthy robots, and of some with a speed of sound that is 5 % too high, among
#: smooth and rough walls, and echoes a metre that nothing known explains.
BY_CHANCE = (210.2, 209.0, 201.3, 190.0, 197.7, 196.2, 192.2), 0.92
STEADY = (206.8, 208.1, 210.9, 213.3, 209.7, 207.9, 202.8), 0.77
LEANING = (287.4, 292.4, 290.6, 270.9, 262.9, 256.0, 244.2), 1.09
SMOOTH = (303.1, 306.1, 305.2, 296.0, 278.8, 264.6, 252.3), 0.84
ROUGH = (332.9, 332.7, 330.7, 315.8, 294.1, 282.6, 274.8), 1.1


@pytest.mark.parametrize(
    ("said", "error"),
    [
        (BY_CHANCE, None),
        (STEADY, None),
        (LEANING, None),
        (SMOOTH, 1.0 / 0.95 - 1.0),
        (ROUGH, 1.0 / 0.93 - 1.0),
    ],
    ids=["by chance", "steady", "leaning", "smooth", "rough"],
)
def test_ranges_are_too_long_if_all_that_are_shorter_fit_better(
    said: tuple[tuple[float, ...], float], error: float | None
) -> None:
    """A healthy robot was said to have a wrong speed of sound by the one scale that fitted best."""
    own, background = dict(zip(SCALES, said[0], strict=True)), said[1]

    found = scale_error(own, dict.fromkeys(SCALES, 0.0), background)

    assert (found and found[0]) == pytest.approx(error)


def test_ranges_are_said_to_be_too_short_only_if_far_more_is_gained() -> None:
    """Round columns answer from in front of the point that they seem to be."""
    longer = dict(zip(SCALES, reversed(SMOOTH[0]), strict=True))

    assert scale_error(longer, dict.fromkeys(SCALES, 0.0), SMOOTH[1]) is None
    times = {scale: 3.0 * said for scale, said in longer.items()}
    assert scale_error(times, dict.fromkeys(SCALES, 0.0), SMOOTH[1]) is not None
