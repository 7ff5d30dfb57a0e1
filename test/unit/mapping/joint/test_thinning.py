"""Where more pings come than can be explained, what is left is a share of each time."""

import numpy as np

from usmap_ros.mapping.joint.thinning import Thinning

WINDOW = 1000


def left_of(total: int) -> list[int]:
    """Numbers of the pings that are left of some, where `WINDOW` of them may be kept."""
    thinning, kept = Thinning(), list[int]()
    for number in range(total):
        if len(kept) >= WINDOW:
            going = set(thinning.going(len(kept)).tolist())
            assert going
            kept = [each for index, each in enumerate(kept) if index not in going]
        kept.append(number)
    return kept


def test_a_like_share_is_left_of_each_time() -> None:
    total = 20 * WINDOW
    left = np.array(left_of(total))
    # All of the newest are there still; of those before, as many from each tenth of the time.
    by_tenth = np.histogram(left, bins=10, range=(0, total))[0][:9]
    assert by_tenth.min() > 0.5 * by_tenth.max() > 0


def test_no_robot_of_those_that_take_turns_is_left_out() -> None:
    left = np.array(left_of(20 * WINDOW))
    assert np.bincount(left % 2).min() > 0.4 * len(left)


def test_what_goes_in_order_lets_the_newest_be_whole_again() -> None:
    thinning = Thinning()
    thinning.going(WINDOW)
    thinning.let_go(WINDOW)
    # As at first.
    assert len(thinning.going(WINDOW)) == len(Thinning().going(WINDOW))
