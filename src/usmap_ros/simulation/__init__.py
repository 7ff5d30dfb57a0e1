"""Scenes, robots on their paths, and the echo simulator."""

from usmap_ros.simulation.hearing import hear
from usmap_ros.simulation.run import record, simulate
from usmap_ros.simulation.scenario import Scenario
from usmap_ros.simulation.simulator import EchoSimulator, MountedTransducer

__all__ = ["EchoSimulator", "MountedTransducer", "Scenario", "hear", "record", "simulate"]
