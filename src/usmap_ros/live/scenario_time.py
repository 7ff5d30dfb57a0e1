"""A scenario's own time, from a clock that may start late, jump, or stand still."""

from usmap_ros.errors import UsmapError

_NANOSECONDS = 1_000_000_000
#: A clock that goes on by more than this from one reading to the next has jumped.
_JUMP_NS = 60 * _NANOSECONDS
#: Longest time since a start that was given.  A path is drawn from its start on: one that began in
#: 1970 would never be caught up with.
LONGEST_AGO_S = 100_000.0


class NoTimeError(UsmapError):
    """A clock that does not say where in the scenario it is."""


class ScenarioTime:
    """Seconds since the scenario began, which never make a robot leap or wait for years.

    Where the start is given, scenario time is the clock's, counted from there, whatever the clock
    does.  Where it is not, the scenario begins with the first reading of the clock, simulated
    time that has not begun yet left aside.  A jump ahead then takes the start along, so that the
    scenario goes on from where it was; a jump to before the start begins it anew.

    Parameters
    ----------
    start_ns : int
        When the scenario begins, nanoseconds of the clock; 0: with its first reading.
    """

    def __init__(self, start_ns: int = 0) -> None:
        #: When the scenario began; 0 until that is known.
        self.start_ns = start_ns
        self._is_given = start_ns > 0
        self._latest_ns = 0

    def at(self, now_ns: int) -> float:
        """Scenario time (s) at a reading of the clock; negative before a start that was given.

        Raises
        ------
        NoTimeError
            If the clock has not started yet, or a start that was given is too long ago.
        """
        if now_ns <= 0:
            raise NoTimeError("the clock has not started; does anybody publish /clock?")
        if not self._is_given:
            self._follow(now_ns)
        self._latest_ns = now_ns
        elapsed_s = (now_ns - self.start_ns) / _NANOSECONDS
        if elapsed_s > LONGEST_AGO_S:
            raise NoTimeError(
                f"start_time_s: is {elapsed_s:.3g} s ago, must be at most {LONGEST_AGO_S:g} s"
            )
        return elapsed_s

    def _follow(self, now_ns: int) -> None:
        """Move the start to where the clock's jumps make no difference."""
        if not self.start_ns or now_ns < self.start_ns:
            self.start_ns = now_ns
        elif now_ns - self._latest_ns > _JUMP_NS:
            self.start_ns += now_ns - self._latest_ns
