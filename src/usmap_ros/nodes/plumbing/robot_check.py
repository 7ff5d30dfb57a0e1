"""Which robots contradict the map that all the others make, looked into now and then."""

import time
import traceback
from typing import Any

from usmap_ros.live import health
from usmap_ros.live.live_fusion import LiveFusion
from usmap_ros.mapping.robot_check.finding import Finding
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.worker import Worker
from usmap_ros.parameters.nodes import MapFusionParameters
from usmap_ros.processes.threads import PATIENCE

#: Share of the time that it may run in the long run, unless that would make it wait for more than
#: so many of its periods.
_SHARE, _MOST_PERIODS = 0.1, 10.0


class _StoppedError(Exception):
    """The check is to end."""


class RobotCheck:
    """Judges the robots at an interval, beside fusion.

    Parameters
    ----------
    node : Node
        Whose log says what is new.
    fusion : LiveFusion
        The map, and the pings of late.
    parameters : ParameterServer
        The interval, as it is at the time.
    problems : Health
        Counts checks that failed.
    """

    def __init__(
        self,
        node: Any,
        fusion: LiveFusion,
        parameters: ParameterServer[MapFusionParameters],
        problems: health.Health,
    ) -> None:
        self._node, self._fusion = node, fusion
        self._parameters, self._problems = parameters, problems
        self._found: dict[str, Finding] = {}
        self._checked_version = -1
        self._is_stopping = False
        self._worker = Worker(node, self._step, patience=PATIENCE)

    def stop(self) -> None:
        """End the check, though it may be under way."""
        self._is_stopping = True
        self._worker.stop()

    def wake(self) -> None:
        """Check now, though the map may be the one of the last check."""
        self._checked_version = -1
        self._worker.wake()

    def suspects(self) -> health.Remark | None:
        """A warning that names the robots whose echoes contradict the others', with why."""
        found = [f"{topic} is {f.reason}" for topic, f in self._found.items() if f.reason]
        return health.Remark(health.Level.WARN, "; ".join(found)) if found else None

    def summary(self) -> str:
        """The verdict on every robot, in one line."""
        return ", ".join(f"{topic} {finding.verdict}" for topic, finding in self._found.items())

    def _step(self) -> float:
        """Check once; runs in the worker's thread."""
        period_s = self._parameters.value.check_period_s
        version = self._fusion.version
        if version == self._checked_version:
            return period_s
        began_s = time.monotonic()
        try:
            found = self._fusion.findings(self._end_if_asked)
        except _StoppedError:
            return period_s
        except Exception as error:  # Mapping goes on, whatever is wrong with the check.
            self._node.get_logger().error(traceback.format_exc())
            self._problems.problem("unchecked", f"robots: {error!r}", is_error=True)
            return period_s
        for topic, finding in found.items():
            before = self._found.get(topic)
            if finding.is_suspect and (before is None or before.verdict != finding.verdict):
                self._node.get_logger().warning(f"{topic} is {finding.reason}")
        self._found, self._checked_version = found, version
        took_s = time.monotonic() - began_s
        return min(max(period_s, took_s / _SHARE), _MOST_PERIODS * period_s)

    def _end_if_asked(self) -> None:
        """Do not wait for what was found if the check is to end."""
        if self._is_stopping:
            raise _StoppedError
