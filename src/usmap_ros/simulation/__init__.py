"""Scenes, robots on their paths, and the echo simulator."""

from __future__ import annotations

from typing import TYPE_CHECKING

from usmap_ros.lazy_names import offered

if TYPE_CHECKING:
    from usmap_ros.simulation.points import hear
    from usmap_ros.simulation.recording import record, simulate, true_paths
    from usmap_ros.simulation.scenario import Scenario
    from usmap_ros.simulation.simulator import EchoSimulator, MountedTransducer

__all__ = [
    "EchoSimulator",
    "MountedTransducer",
    "Scenario",
    "hear",
    "record",
    "simulate",
    "true_paths",
]

__getattr__ = offered(
    __name__,
    {
        "points": ["hear"],
        "recording": ["record", "simulate", "true_paths"],
        "scenario": ["Scenario"],
        "simulator": ["EchoSimulator", "MountedTransducer"],
    },
)
