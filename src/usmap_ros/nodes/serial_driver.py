"""Node that lets a transducer behind a serial line ping."""

from typing import Any

from usmap_ros.drivers.port import Port
from usmap_ros.drivers.serial_transducer import SerialTransducer
from usmap_ros.importing import Sensor
from usmap_ros.live.interfaces import SERIAL_DRIVER
from usmap_ros.nodes.plumbing.device_driver import DeviceDriver
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.run import run_node
from usmap_ros.parameters.nodes import SerialDriverParameters


class SerialDriver(DeviceDriver):
    """Publishes ``echo`` and ``range`` of a device that answers triggers with frames of samples.

    Keyword arguments are those of `rclpy.node.Node`.
    """

    name = SERIAL_DRIVER.name
    group = SerialDriverParameters
    parameters: ParameterServer[Any]

    def make_source(self, sensor: Sensor) -> SerialTransducer:
        """The device on its port."""
        parameters: SerialDriverParameters = self.parameters.value
        if not parameters.device:
            raise self.parameters.refused("device", "is missing")
        port = Port(parameters.device, parameters.baud_rate)
        return SerialTransducer(port, sensor, parameters.answer_timeout_s)


def main() -> None:
    """Run the node."""
    run_node(SerialDriver)


if __name__ == "__main__":
    main()
