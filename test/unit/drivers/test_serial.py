"""A device behind a serial line: its frames, its port, and what it does wrong."""

import socket
import struct
import threading
import zlib

import numpy as np
import pytest
from played_devices import SENSOR, PlayedDevice, counts, frame

from usmap_ros.drivers import DeviceError, NoAnswerError
from usmap_ros.drivers.frames import FrameReader, SampleFrame
from usmap_ros.drivers.port import Port
from usmap_ros.drivers.serial_transducer import SerialTransducer
from usmap_ros.errors import MalformedMessageError
from usmap_ros.importing import Recording, Sensor
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import Encoding

BASE = Pose.planar(1.0, 2.0, np.pi / 2.0)


@pytest.fixture
def sensor(tmp_path):
    path = tmp_path / "sensor.yaml"
    path.write_text(SENSOR, encoding="utf-8")
    return Sensor(Recording.load(path))


@pytest.fixture
def device(tmp_path):
    played = PlayedDevice(tmp_path / "ttyPlayed")
    yield played
    played.end()


@pytest.fixture
def transducer(device, sensor):
    source = SerialTransducer(Port(str(device.path), 115200), sensor, 0.3)
    source.open()
    yield source
    source.close()


@pytest.mark.parametrize("dtype", ["<i2", "<u2", "<f4"])
def test_frames_come_in_pieces_of_any_length(dtype):
    samples = np.arange(50).astype(dtype)
    line = (
        b"boot: ok\r\n"
        + SampleFrame(7, samples).packed()
        + b"US"
        + SampleFrame(8, samples[:0]).packed()
    )
    for piece in (1, 3, 20, len(line)):
        reader = FrameReader()
        found = [
            one for at in range(0, len(line), piece) for one in reader.feed(line[at : at + piece])
        ]
        assert [one.number for one in found] == [7, 8]
        assert found[0].samples.tolist() == samples.tolist()
        assert found[0].samples.dtype == np.dtype(dtype)


def test_frame_is_what_the_page_says():
    content = b"USM1" + bytes([9, 0, 2, 0]) + struct.pack("<hh", 3, -4)
    expected = content + struct.pack("<I", zlib.crc32(content))
    assert SampleFrame(9, np.array([3, -4], dtype="<i2")).packed() == expected


def test_damaged_frame_is_named_and_the_next_one_found():
    damaged = bytearray(frame(1))
    damaged[500] ^= 1
    wrong_type = bytearray(frame(2))
    wrong_type[5] = 9
    found = list(FrameReader().feed(bytes(damaged + wrong_type) + frame(3)))

    assert [str(one) for one in found[:2]] == [
        "frame.checksum: is wrong: bytes were lost or damaged on the line",
        "frame.type: is 9, must be one of [0, 1, 2]",
    ]
    assert found[2].number == 3


def test_pings_become_traces(transducer):
    for number in (1, 2):
        (trace,) = transducer.ping(1_000_000_000 * number, BASE)

        assert trace.samples == pytest.approx(counts(number) / 1000.0)
        assert trace.stamp_ns == 1_000_000_000 * number
        assert trace.encoding is Encoding.RAW
        assert trace.child_frame_id == "robot1/sonar"
        assert trace.pose.position_m == pytest.approx([1.0, 2.1, 0.2])
        assert np.diag(trace.pose.planar_covariance) == pytest.approx([1e-4, 1e-4, 0.0])


def test_late_answer_is_not_taken_for_the_next_one(transducer, device):
    device.answer = lambda number: b""
    with pytest.raises(NoAnswerError, match=r"within 0\.3 s came nothing"):
        transducer.ping(1, BASE)
    device.answer = lambda number: frame(number - 1) + frame(number)
    (trace,) = transducer.ping(2, BASE)
    assert trace.samples == pytest.approx(counts(2) / 1000.0)


def test_what_is_wrong_is_said(transducer, device):
    device.answer = lambda number: b"\xff\x00" * 30
    with pytest.raises(NoAnswerError, match="60 bytes, which are no frame: baud_rate"):
        transducer.ping(1, BASE)
    device.answer = lambda number: frame(number)[:-1] + b"?"
    with pytest.raises(MalformedMessageError, match="checksum"):
        transducer.ping(2, BASE)
    device.answer = lambda number: SampleFrame(number, np.full(9, np.nan, dtype="<f4")).packed()
    with pytest.raises(MalformedMessageError, match="samples"):
        transducer.ping(3, BASE)


def test_device_that_is_lost_can_be_opened_again(transducer, device):
    device.pull_out()
    with pytest.raises(DeviceError):
        transducer.ping(1, BASE)
    with pytest.raises(DeviceError, match="ttyPlayed: No such file"):
        transducer.open()
    device.plug_in()
    transducer.open()
    assert len(transducer.ping(2, BASE)) == 1


def test_port_that_cannot_be_used_is_refused(tmp_path, device, transducer):
    (tmp_path / "file").write_text("")
    for path, baud_rate, cause in [
        (tmp_path / "file", 115200, "is no serial port"),
        (device.path, 115200, "is in use by another program"),
        ("tcp://nowhere", 115200, "tcp://nowhere: "),
        ("tcp://127.0.0.1:1", 115200, "refused"),
    ]:
        with pytest.raises(DeviceError, match=cause):
            Port(str(path), baud_rate).open()
    transducer.close()
    with pytest.raises(DeviceError, match="has 12345 baud"):
        Port(str(device.path), 12345).open()


def test_network_connection_takes_the_place_of_a_port(sensor):
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer():
            connection, _ = server.accept()
            with connection:
                connection.sendall(frame(connection.recv(2)[1]))

        device = threading.Thread(target=answer)
        device.start()
        source = SerialTransducer(
            Port(f"tcp://127.0.0.1:{server.getsockname()[1]}", 9600), sensor, 5.0
        )
        source.open()
        assert len(source.ping(1, BASE)[0].samples) == 3600
        device.join()
        with pytest.raises(DeviceError, match="is gone"):
            source.ping(2, BASE)
        source.close()
