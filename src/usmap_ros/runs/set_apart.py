"""Which pings of a recording make one map, and which are set apart."""

from collections import Counter
from collections.abc import Iterable, Iterator

from usmap_ros.mapping.common_frame import CommonFrame
from usmap_ros.mapping.far_off import FarOff, FarOffError, Ping
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.restarts import MARK

#: Why pings are set apart.
OTHER_FRAME, FAR_OFF = "in another frame", "far off"


class SetApart:
    """Account of pings that are sound, but not of the map."""

    def __init__(self) -> None:
        # By why and topic: pings that came, less those that passed; and what is to be said of them.
        self._counts: dict[str, Counter[str]] = {OTHER_FRAME: Counter(), FAR_OFF: Counter()}
        self._causes: dict[tuple[str, str], str] = {}

    def came(self, why: str, ping: Ping, cause: str = "") -> None:
        """Count a ping that is set apart unless it passes later."""
        topic, _ = ping
        self._counts[why][topic] += 1
        if cause:
            self._causes[why, topic] = cause

    def passed(self, why: str, ping: Ping) -> None:
        """Count a ping no more: it is mapped."""
        self._counts[why][ping[0]] -= 1

    def summary(self) -> dict[str, dict[str, int]]:
        """Number of pings by topic and by why."""
        found: dict[str, dict[str, int]] = {}
        for why, counts in self._counts.items():
            for topic, count in (+counts).items():
                found.setdefault(topic, {})[why] = count
        return found

    def causes(self) -> dict[str, str]:
        """What is to be said of each topic."""
        return {
            topic: "; ".join(
                f"{count} pings are set apart, {self._causes.get((why, topic), why)}"
                for why, count in counts.items()
            )
            for topic, counts in self.summary().items()
        }


def in_one_frame(pings: Iterable[Ping], frame: CommonFrame, apart: SetApart) -> Iterator[Ping]:
    """Those of the frame that most robots share, once it is known; `apart` counts the others.

    Parameters
    ----------
    pings : iterable of (str, EchoCone)
        Topic and cone, in the order of their stamps.
    frame : CommonFrame
        Decides which frame is the map's.
    apart : SetApart
        Counts what is set apart, by cause.
    """

    def sorted_out(waiting: list[Ping]) -> Iterator[Ping]:
        for ping in waiting:
            if ping[1].frame_id == frame.frame_id:
                yield ping
            else:
                apart.came(OTHER_FRAME, ping, _why_other(ping[1].frame_id, frame.frame_id))

    waiting: list[Ping] = []
    for ping in pings:
        frame.add(*ping)
        frame.decide()
        waiting.append(ping)
        if frame.is_decided:
            # All of them are in `waiting`.
            frame.take_held()
            yield from sorted_out(waiting)
            waiting = []
    frame.decide(is_over=True)
    yield from sorted_out(waiting)


def _why_other(own: str, common: str) -> str:
    why = f"header.frame_id: is '{own}', the map's is '{common}'"
    # Nobody but this program called a frame so.
    begun_anew = "its odometry jumped, or it was carried off: '--poses told' takes it as told"
    return f"{why} ({begun_anew})" if MARK in own else why


def in_one_place(pings: Iterable[Ping], far: FarOff, apart: SetApart) -> Iterator[Ping]:
    """Those from where most robots are, once it is known; `apart` counts the others.

    Parameters are those of `in_one_frame`, but for `far`, which decides.
    """
    waiting: list[Ping] = []
    for ping in pings:
        cause = ""
        try:
            waiting += far.add(*ping)
        except FarOffError as error:
            cause = str(error)
        apart.came(FAR_OFF, ping, cause)
        anew = far.decide()
        waiting = waiting if anew is None else anew
        if far.is_decided:
            for one in waiting:
                apart.passed(FAR_OFF, one)
            yield from waiting
            waiting = []
    anew = far.decide(is_over=True)
    waiting = (waiting if anew is None else anew) + far.finish()
    for one in waiting:
        apart.passed(FAR_OFF, one)
    yield from waiting


def pings_of_one_map(pings: Iterable[Ping], pipeline: Pipeline, apart: SetApart) -> Iterator[Ping]:
    """Those that a pipeline is to map: of one frame, and not far from all others.

    Parameters
    ----------
    pings : iterable of (str, EchoCone)
        Topic and cone, in the order of their stamps.
    pipeline : Pipeline
        Its map's frame holds if it has one, and so does the place of a map that it resumes.
    apart : SetApart
        Counts the others.

    Raises
    ------
    MapSizeError
        If the map that is resumed is too large.
    """
    far = FarOff(pipeline.parameters.mapping)
    if pipeline.resumed is not None:
        far.cover(pipeline.resumed.geometry)
    frame = CommonFrame(pipeline.fusion.frame_id)
    yield from in_one_place(in_one_frame(pings, frame, apart), far, apart)
