"""Recordings of one's own hardware: arrays and files of other formats, made into echo traces."""

from usmap_ros.importing.description import Recording
from usmap_ros.importing.sensor import Sensor
from usmap_ros.importing.traces import imported_traces
from usmap_ros.importing.units import unit_problem

__all__ = ["Recording", "Sensor", "imported_traces", "unit_problem"]
