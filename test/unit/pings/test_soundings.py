"""Traces of one ping of an array go together."""

from dataclasses import dataclass
from types import SimpleNamespace

from usmap_ros.pings.soundings import SoundingCollector, soundings


@dataclass(frozen=True)
class Ping:
    """What a collector looks at in a trace."""

    stamp_ns: int
    array: SimpleNamespace | None = None


PAIR = SimpleNamespace(frame_ids=("left", "right"))
OTHERS = SimpleNamespace(frame_ids=("front", "back"))


def grouped(pings):
    return [
        [label for label, _ in sounding]
        for sounding in soundings((number, ping) for number, ping in enumerate(pings))
    ]


def test_a_transducer_that_pings_alone_is_a_sounding():
    assert grouped([Ping(1), Ping(1), Ping(2)]) == [[0], [1], [2]]


def test_traces_of_an_array_go_together_whatever_comes_between():
    pings = [Ping(1, PAIR), Ping(1), Ping(1, OTHERS), Ping(1, PAIR), Ping(1, OTHERS)]
    assert grouped(pings) == [[1], [0, 3], [2, 4]]


def test_what_is_missing_is_not_waited_for_beyond_the_next_stamp():
    assert grouped([Ping(1, PAIR), Ping(2), Ping(3, PAIR), Ping(3, PAIR)]) == [[0], [1], [2, 3]]


def test_what_still_waits_comes_at_the_end():
    collector = SoundingCollector()
    assert collector.add("a", Ping(1, PAIR)) == []
    assert collector.flush() == [[("a", Ping(1, PAIR))]]
    assert collector.flush() == []
