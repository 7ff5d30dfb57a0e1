"""Arrays complete the traces of their elements."""

from dataclasses import replace

import numpy as np
import pytest
from made_pings import TRACE

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.soundings import TransducerArrays
from usmap_ros.pings.transducer_array import ArrayElement, TransducerArray

RISING = Pulse(PulseShape.CHIRP, 50e3, 2e-3, 20e3)
FALLING = Pulse(PulseShape.CHIRP, 50e3, 2e-3, -20e3)


def transducer(pulse):
    return Transducer(pulse, BeamPattern.linear(), 0.2, 5.0)


def trace(frame="left", stamp_ns=10, pulse=RISING):
    """Return a trace as a message has it: without a sweep."""
    return replace(
        TRACE,
        stamp_ns=stamp_ns,
        child_frame_id=frame,
        transducer=transducer(replace(pulse, sweep_hz=0.0)),
    )


LEFT = ArrayElement("left", Pose.planar(0.2, 0.1, np.pi / 2.0), True, transducer(RISING))
RIGHT = ArrayElement("right", Pose.planar(0.2, -0.1, 0.0), True, transducer(FALLING))


def test_a_single_chirp_is_told_its_sweep():
    array = TransducerArray(0, "base", (LEFT,))

    completed = trace().in_array(array)

    assert completed.transducer.pulse == RISING
    assert [one.transducer.pulse for one in completed.sent] == [RISING]


def test_all_pulses_in_the_air_are_listed_where_they_were_sent():
    completed = trace().in_array(TransducerArray(0, "base", (LEFT, RIGHT)))

    own, other = completed.sent
    assert (own.child_frame_id, other.child_frame_id) == ("left", "right")
    assert other.transducer.pulse == FALLING
    np.testing.assert_allclose(own.mount.position_m, 0.0, atol=1e-12)
    # The left one looks along the base's y axis: the right one is behind it.
    np.testing.assert_allclose(other.mount.position_m, [-0.2, 0.0, 0.0], atol=1e-12)
    assert other.mount.yaw_rad == pytest.approx(-np.pi / 2.0)


def test_a_listener_hears_what_others_sent():
    deaf = replace(LEFT, emits=False)

    completed = trace().in_array(TransducerArray(0, "base", (deaf, RIGHT)))

    assert [emission.child_frame_id for emission in completed.sent] == ["right"]


def test_a_trace_of_another_pulse_is_refused():
    other = trace(pulse=replace(RISING, duration_s=1e-3))

    with pytest.raises(MalformedMessageError, match="TransducerArray says of 'left'"):
        other.in_array(TransducerArray(0, "base", (LEFT,)))


def test_the_newest_array_before_a_trace_holds():
    known = TransducerArrays(
        [
            TransducerArray(20, "base", (replace(LEFT, transducer=transducer(FALLING)),)),
            TransducerArray(5, "base", (LEFT,)),
        ]
    )

    sweeps = [
        known.complete(trace(stamp_ns=stamp)).transducer.pulse.sweep_hz for stamp in (4, 5, 19, 20)
    ]

    assert sweeps == [0.0, 20e3, 20e3, -20e3]


def test_traces_of_others_stay_as_they_are():
    stranger = trace(frame="stranger")
    assert TransducerArrays([TransducerArray(0, "base", (LEFT,))]).complete(stranger) is stranger


@pytest.mark.parametrize(
    ("elements", "cause"),
    [
        ((), "is empty"),
        ((replace(LEFT, emits=False),), "none that emits"),
        ((LEFT, LEFT), "stands twice"),
        ((replace(LEFT, transducer=transducer(replace(RISING, sweep_hz=np.inf))),), "sweep"),
    ],
)
def test_an_impossible_array_is_refused(elements, cause):
    with pytest.raises(MalformedMessageError, match=cause):
        TransducerArray(0, "base", elements).validate()
