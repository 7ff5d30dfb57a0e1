"""Recordings of one's own hardware: arrays and files of other formats, made into echo traces."""

from usmap_ros.importing.description import Recording
from usmap_ros.importing.traces import imported_traces

__all__ = ["Recording", "imported_traces"]
