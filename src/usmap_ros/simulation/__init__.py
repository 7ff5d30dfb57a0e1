"""Scenes, robots on their paths, and the echo simulator."""

from usmap_ros.simulation.points import hear
from usmap_ros.simulation.recording import record, simulate
from usmap_ros.simulation.scenario import Scenario
from usmap_ros.simulation.simulator import EchoSimulator, MountedTransducer

__all__ = ["EchoSimulator", "MountedTransducer", "Scenario", "hear", "record", "simulate"]
