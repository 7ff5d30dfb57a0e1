"""What a replay waits for before it begins: that all who will listen do."""

from collections.abc import Collection, Mapping

#: What `cone_reconstructor` reports: how many subscribers it knows of its cones.
LISTENERS = "listeners"
#: So long nothing may change before the start: who answers is not seen all at once.
SETTLING_S = 0.5


class Attendance:
    """Tells when a replay may begin.

    Whoever joins is seen by each of the others at a time of its own.  That the replay sees a fusion
    that listens to cones does not mean that the reconstructor does, and what that publishes before
    is lost in silence: so reconstructors are asked, by what they report on ``/diagnostics``.
    Nothing here asks for the time.

    Parameters
    ----------
    patience_ends_s : float
        When to begin in any case.
    """

    def __init__(self, patience_ends_s: float) -> None:
        self._patience_ends_s = patience_ends_s
        self._known: dict[str, int] = {}
        self._last_seen: object = None
        self._unchanged_since_s = 0.0

    def reported(self, name: str, facts: Mapping[str, str]) -> None:
        """Note what a node says of itself; without effect if it says nothing of listeners."""
        if facts.get(LISTENERS, "").isdecimal():
            self._known[name] = int(facts[LISTENERS])

    def is_complete(
        self, now_s: float, missing: Collection[str], listeners: Mapping[str, int]
    ) -> bool:
        """Whether everybody is there, or has been waited for long enough.

        Parameters
        ----------
        now_s : float
            Seconds of a clock that never runs backwards.
        missing : collection of str
            Topics that nobody is seen to listen to, or to publish, who should.
        listeners : mapping of str to int
            Nodes that make cones, by their full names, and how many subscribers the replay sees
            of those.
        """
        unaware = [name for name, seen in listeners.items() if self._known.get(name, 0) < seen]
        seen = (sorted(missing), sorted(listeners.items()), unaware)
        if seen != self._last_seen:
            self._last_seen, self._unchanged_since_s = seen, now_s
        if now_s >= self._patience_ends_s:
            return True
        has_settled = not listeners or now_s - self._unchanged_since_s >= SETTLING_S
        return not missing and not unaware and has_settled
