"""What drivers ping with: devices behind one small interface, the simulated one among them."""

from usmap_ros.drivers.ping_source import DeviceError, NoAnswerError, PingSource

__all__ = ["DeviceError", "NoAnswerError", "PingSource"]
