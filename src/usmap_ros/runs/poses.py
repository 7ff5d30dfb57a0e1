"""Which poses a recording is mapped with: those that were told, or corrected ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from usmap_ros.grids import OccupancyMap
from usmap_ros.localisation.pose_kind import PoseKind, pose_kind, robot_of
from usmap_ros.mapping.far_off import Ping
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.fields_of_view import Beam
from usmap_ros.pings.robot_paths import RobotPaths

#: A robot whose covariance has not grown over so long a way, or so many pings, has absolute poses.
_WAY_M, _PINGS = 1.0, 2000


@dataclass
class PoseRun:
    """What became of the poses of a recording."""

    #: ``poses`` says what a user insists on.
    parameters: PipelineParameters = field(default_factory=PipelineParameters)
    #: The map's frame, if it is stated.
    frame_id: str = ""
    #: The map that is resumed.
    earlier: OccupancyMap | None = None
    #: Paths as they were told, if they were refined.
    told: RobotPaths = field(default_factory=RobotPaths)
    #: What poses were and how far they were moved, by robot, for ``summary.json``.
    robots: dict[str, Any] = field(default_factory=dict)

    def summary(self) -> dict[str, Any]:
        """Of a map's ``summary.json``."""
        return {"used": "refined" if self.robots else "told", "robots": self.robots}

    def corrected(self, pings: Iterable[Ping]) -> Iterator[Ping]:
        """Pings with the poses that they are to be mapped with.

        Pings are held back until it is known whether poses must be corrected; and until the last
        one is there if any must.
        """
        wanted = self.parameters.poses
        if wanted.use == "told" and not wanted.starts():
            yield from pings
            return
        stream = iter(pings)
        held: list[Ping] = []
        # What is mapped as it was told, and may still help to find where a late robot is.
        done: deque[Ping] = deque(maxlen=self.parameters.mapping.window)
        watch = PoseWatch(wanted.use != "auto")
        for ping in stream:
            held.append(ping)
            watch.add(ping)
            if watch.must_correct:
                break
            if watch.is_settled:
                yield from held
                done.extend(held)
                held.clear()
        if not watch.must_correct:
            yield from held
            return
        held.extend(stream)
        if held:
            yield from self._refined(held, list(done))

    def _refined(self, held: list[Ping], done: list[Ping]) -> list[Ping]:
        """Those that were held, corrected beside those that were mapped as told before them."""
        from usmap_ros.runs.correction import correct_poses
        from usmap_ros.runs.restarts import Restarts

        restarts = Restarts()
        lives = [restarts.renamed(ping) for ping in (*done, *held)]
        corrected = correct_poses(lives, self.parameters, self.frame_id, earlier=self.earlier)
        self.robots = {robot: one.summary() for robot, one in corrected.robots.items()}
        for topic, cone in held:
            x_m, y_m, _ = map(float, cone.pose.position_m)
            self.told.add(topic, x_m, y_m, Beam.of(cone), cone.stamp_ns)
        return corrected.pings[len(done) :]


class PoseWatch:
    """Whether any robot's poses are not right as told, as far as the pings so far tell.

    Parameters
    ----------
    is_known : bool
        That a user said so.

    Attributes
    ----------
    must_correct : bool
        Whether those of one are not: it drifts, or is off by chance.
    """

    def __init__(self, is_known: bool = False) -> None:
        self.must_correct = is_known
        # Robots of which it is not known yet; and those of which it is.
        self._watched: dict[str, _Watch] = {}
        self._settled: set[str] = set()

    @property
    def is_settled(self) -> bool:
        """Whether it is known of every robot so far."""
        return self.must_correct or not self._watched

    def add(self, ping: Ping) -> None:
        """Look at another ping."""
        robot = robot_of(*ping)
        if self.must_correct or robot in self._settled:
            return
        kind = self._watched.setdefault(robot, _Watch()).add(ping[1])
        if kind is not None:
            self._settled.add(robot)
            del self._watched[robot]
            self.must_correct = kind.must_correct


class _Watch:
    """What is known so far of a robot's poses."""

    def __init__(self) -> None:
        self.cones: list[EchoCone] = []
        # Of each transducer: from one to the next one is no way that the robot goes.
        self._ways_m: dict[str, float] = {}
        self._last_m: dict[str, FloatArray] = {}

    def add(self, cone: EchoCone) -> PoseKind | None:
        """What its poses are; None while that is not known."""
        transducer, place_m = cone.child_frame_id, cone.pose.position_m[:2]
        step_m = place_m - self._last_m.get(transducer, place_m)
        way_m = self._ways_m.get(transducer, 0.0) + float(np.hypot(*step_m))
        self._ways_m[transducer], self._last_m[transducer] = way_m, place_m
        self.cones.append(cone)
        kind = pose_kind([self.cones[0], cone])
        if kind.must_correct:
            # Between the two it may have gone up and down; only all of them tell.
            kind = pose_kind(self.cones)
        is_settled = way_m >= _WAY_M or len(self.cones) >= _PINGS
        return kind if kind.must_correct or is_settled else None
