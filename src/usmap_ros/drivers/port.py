"""A serial port, or a network connection in its place."""

import os
import select
import socket
from contextlib import suppress

from usmap_ros.drivers.ping_source import DeviceError

_TCP = "tcp://"
#: How long a host may take to let itself be reached, s.
_CONNECT_S = 3.0
#: Read at once.
_CHUNK = 65536


class Port:
    """Bytes to and from a device.

    Parameters
    ----------
    address : str
        A serial port such as ``/dev/ttyUSB0``, or ``tcp://HOST:PORT``.
    baud_rate : int
        Of a serial port.
    """

    def __init__(self, address: str, baud_rate: int) -> None:
        self.address = address
        self._baud_rate = baud_rate
        self._descriptor = -1

    def open(self) -> None:
        """Open it; raise `DeviceError` if that cannot be done."""
        self.close()
        try:
            if self.address.startswith(_TCP):
                host, _, port = self.address.removeprefix(_TCP).rpartition(":")
                self._descriptor = socket.create_connection((host, int(port)), _CONNECT_S).detach()
                os.set_blocking(self._descriptor, False)
            else:
                flags = os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK
                self._descriptor = os.open(self.address, flags)
                self._set_up_serial()
        except (OSError, ValueError) as error:
            self.close()
            raise DeviceError(f"{self.address}: {_cause(error)}") from error

    def _set_up_serial(self) -> None:
        """Bytes as they are, at the rate that is set, for this program alone."""
        # Not everywhere, and nobody else needs them.
        import fcntl
        import termios
        import tty

        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            tty.setraw(self._descriptor)
            settings = termios.tcgetattr(self._descriptor)
            speed = getattr(termios, f"B{self._baud_rate}", None)
            if speed is None:
                raise ValueError(f"no serial port here has {self._baud_rate} baud")
            settings[4] = settings[5] = speed
            settings[2] |= termios.CLOCAL | termios.CREAD
            termios.tcsetattr(self._descriptor, termios.TCSANOW, settings)
            termios.tcflush(self._descriptor, termios.TCIOFLUSH)
        except BlockingIOError as error:
            raise OSError("is in use by another program") from error
        except termios.error as error:
            raise OSError(f"is no serial port ({error.args[-1]})") from error

    def close(self) -> None:
        """Close it; nothing if it is not open."""
        if self._descriptor >= 0:
            with suppress(OSError):  # It may be gone already.
                os.close(self._descriptor)
            self._descriptor = -1

    def write(self, data: bytes) -> None:
        """Send a few bytes; raise `DeviceError` if the device is gone."""
        try:
            written = os.write(self._descriptor, data)
        except OSError as error:
            raise DeviceError(f"{self.address}: {_cause(error)}") from error
        if written != len(data):
            raise DeviceError(f"{self.address}: takes no more bytes")

    def read(self, timeout_s: float) -> bytes:
        """What has come, or comes first within a time; nothing if nothing does.

        Raises
        ------
        DeviceError
            If the device is gone.
        """
        try:
            ready, _, _ = select.select([self._descriptor], [], [], max(0.0, timeout_s))
            data = os.read(self._descriptor, _CHUNK) if ready else None
        except (OSError, ValueError) as error:
            raise DeviceError(f"{self.address}: {_cause(error)}") from error
        if data == b"":
            raise DeviceError(f"{self.address}: is gone")
        return data or b""


def _cause(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
