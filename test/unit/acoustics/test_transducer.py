"""The transducer."""

import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError

PULSE = Pulse(PulseShape.HANN_BURST, 50_000.0, 0.00032)


def test_a_possible_one_is_accepted():
    Transducer(PULSE, BeamPattern.linear(), 0.2, 5.0).validate()


@pytest.mark.parametrize(
    ("limits", "field"),
    [
        ((-0.1, 5.0), "min_range"),
        ((5.0, 5.0), "max_range"),
        ((0.2, float("inf")), "max_range"),
        ((float("nan"), 5.0), "min_range"),
    ],
)
def test_impossible_ranges_are_refused(limits, field):
    with pytest.raises(MalformedMessageError, match=field):
        Transducer(PULSE, BeamPattern.linear(), *limits).validate()
