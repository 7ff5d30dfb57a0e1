"""The frame that most robots share, whoever speaks first."""

from collections import Counter
from collections.abc import Mapping

from usmap_ros.pings.cone import EchoCone

#: Pings, and seconds of some robot's stamps, after which it is decided what most agree on; pings
#: after which it is in any case, whatever their stamps.
ENOUGH_PINGS, ENOUGH_S, MOST_PINGS = 30, 3.0, 1000


class Opening:
    """The first seconds of pings, during which what most agree on is not known yet."""

    def __init__(self) -> None:
        self._pings = 0
        self._first_ns: dict[str, int] = {}
        self._has_lasted = False

    @property
    def is_over(self) -> bool:
        """Whether enough was heard to decide."""
        return self._pings >= MOST_PINGS or (self._has_lasted and self._pings >= ENOUGH_PINGS)

    def add(self, topic: str, stamp_ns: int) -> None:
        """Count a ping."""
        self._pings += 1
        # A robot's own stamps: others' clocks may be hours away.
        first_ns = self._first_ns.setdefault(topic, stamp_ns)
        self._has_lasted |= stamp_ns - first_ns >= ENOUGH_S * 1e9


def shares(pings: Counter[str], of: Mapping[str, int]) -> dict[str, int]:
    """Millionths of each robot's pings, so that whoever floods has no more of a say than others.

    Parameters
    ----------
    pings : Counter of str
        How many of its pings say the same, by topic.
    of : mapping of str to int
        How many there are.
    """
    # Whole numbers, so that equal shares are equal.
    return {topic: count * 1_000_000 // of[topic] for topic, count in pings.items()}


class CommonFrame:
    """The map's frame: the one that is stated, or the one that most robots' pings are in.

    Until that is decided, the frame of the first ping stands in.

    Parameters
    ----------
    frame_id : str
        The frame if it is stated; empty otherwise.

    Attributes
    ----------
    frame_id : str
        The frame, as far as it is known; empty before the first ping.
    is_decided : bool
        Whether it stays.
    """

    def __init__(self, frame_id: str = "") -> None:
        self.frame_id = frame_id
        self.is_decided = bool(frame_id)
        self._opening = Opening()
        # Of each frame and of all: pings by topic.
        self._frames: dict[str, Counter[str]] = {}
        self._pings: Counter[str] = Counter()
        self._held: list[tuple[str, EchoCone]] = []

    def add(self, topic: str, cone: EchoCone) -> bool:
        """Take a ping into account.

        Returns
        -------
        is_in : bool
            Whether it is in the frame as it is now.  While that is not decided, others are held.
        """
        self.frame_id = self.frame_id or cone.frame_id
        is_in = cone.frame_id == self.frame_id
        if not self.is_decided:
            self._frames.setdefault(cone.frame_id, Counter())[topic] += 1
            self._pings[topic] += 1
            self._opening.add(topic, cone.stamp_ns)
            if not is_in:
                self._held.append((topic, cone))
        return is_in

    def decide(self, *, is_over: bool = False) -> bool:
        """Decide if enough was heard, or nothing more comes.

        Parameters
        ----------
        is_over : bool
            Whether nothing more comes.

        Returns
        -------
        has_changed : bool
            Whether it is another frame than the one that stood in: the map has to begin anew with
            those pings of `take_held` that are in it.
        """
        if self.is_decided or not (is_over or self._opening.is_over) or not self.frame_id:
            return False
        before = self.frame_id
        # The first of several that are equal.
        self.frame_id = max(self._frames, key=lambda frame_id: self._votes(self._frames[frame_id]))
        self.is_decided = True
        return self.frame_id != before

    def _votes(self, pings: Counter[str]) -> tuple[int, int]:
        return sum(shares(pings, self._pings).values()), pings.total()

    def take_held(self) -> list[tuple[str, EchoCone]]:
        """Topic and cone of the pings that were held, in their order; they are held no more."""
        held, self._held = self._held, []
        return held
