"""Recordings made of files of other formats, and what is said of units that are wrong."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import wavfile
from typer.testing import CliRunner

from usmap_ros.cli.app import app
from usmap_ros.errors import ConfigurationError, FileError
from usmap_ros.importing import imported_traces
from usmap_ros.io.bags import read_bag
from usmap_ros.pings.trace import Encoding

PINGS, RATE_HZ = 6, 200e3
DESCRIPTION = {
    "samples": {"path": "pings.npz", "sample_rate_hz": RATE_HZ, "full_scale": 500.0},
    "pulse": {"shape": "tone_burst", "carrier_hz": 40e3, "duration_s": 2e-4},
    "min_range_m": 0.2,
    "max_range_m": 3.0,
}
COUNTS = np.random.default_rng(1).integers(-300, 300, (PINGS, 3600)).astype(np.int16)
POSES = {
    "time_s": 100.0 + 0.1 * np.arange(PINGS),
    "x_m": 0.02 * np.arange(PINGS),
    "y_m": np.ones(PINGS),
    "yaw_rad": 0.1 * np.arange(PINGS),
}


def described(folder: Path, change=None, samples=None, poses=None) -> Path:
    """Write a description, and the files that it names."""
    content = DESCRIPTION | (change or {})
    content["samples"] = content["samples"] | (samples or {})
    np.savez(folder / "pings.npz", samples=COUNTS, **(POSES | (poses or {})))
    path = folder / "sensor.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


def test_arrays_become_traces(tmp_path):
    traces = list(imported_traces(described(tmp_path)))
    topic, trace = traces[2]

    assert len(traces) == PINGS
    assert topic == "/robot1/echo"
    assert trace.samples == pytest.approx(COUNTS[2] / 500.0)
    assert trace.stamp_ns == 100_200_000_000
    assert trace.pose.position_m == pytest.approx([0.04, 1.0, 0.0])
    assert trace.pose.yaw_rad == pytest.approx(0.2)
    assert trace.encoding is Encoding.RAW


def test_command_makes_a_recording(tmp_path):
    done = CliRunner().invoke(
        app, ["import", str(described(tmp_path)), "-o", str(tmp_path / "bag")]
    )

    assert done.exit_code == 0, done.output
    assert f"{PINGS} pings" in done.output
    assert len(list(read_bag(tmp_path / "bag"))) == PINGS
    again = ["import", str(tmp_path / "sensor.yaml"), "-o", str(tmp_path / "bag"), "--force"]
    assert CliRunner().invoke(app, again[:-1]).exit_code == 1
    assert CliRunner().invoke(app, again).exit_code == 0


def write_poses(folder):
    lines = [
        ",".join(POSES),
        *(",".join(map(str, row)) for row in zip(*POSES.values(), strict=True)),
    ]
    (folder / "poses.csv").write_text("\n".join(lines), encoding="utf-8")
    return {"poses": {"path": "poses.csv"}}


@pytest.mark.parametrize("kind", ["csv", "npy", "wav files", "one wav"])
def test_every_format_gives_the_same(tmp_path, kind):
    change, rate_hz = write_poses(tmp_path), int(RATE_HZ)
    if kind == "csv":
        np.savetxt(tmp_path / "pings.csv", COUNTS, fmt="%d", delimiter=",")
        samples = {"path": "pings.csv"}
    elif kind == "npy":
        np.save(tmp_path / "pings.npy", COUNTS)
        samples = {"path": "pings.npy"}
    elif kind == "wav files":
        for number, row in enumerate(COUNTS):
            wavfile.write(tmp_path / f"ping{number}.wav", rate_hz, row)
        samples = {"path": "ping*.wav", "sample_rate_hz": 0.0}
    else:
        whole = np.zeros((PINGS, rate_hz // 10), dtype=np.int16)
        whole[:, : COUNTS.shape[1]] = COUNTS
        wavfile.write(tmp_path / "all.wav", rate_hz, whole.reshape(-1))
        samples = {"path": "all.wav", "sample_rate_hz": 0.0}
    traces = list(imported_traces(described(tmp_path, change, samples)))

    assert len(traces) == PINGS
    for (_, trace), row in zip(traces, COUNTS, strict=True):
        assert trace.samples[:3600] == pytest.approx(row / 500.0)


def test_pairs_become_iq(tmp_path):
    path = described(tmp_path, samples={"encoding": "iq", "sample_rate_hz": 25e3,
                                        "full_scale": 1.0},
                     change={"max_range_m": 6.0})  # fmt: skip
    _, trace = next(imported_traces(path))

    assert trace.encoding is Encoding.IQ
    assert trace.signal()[:2] == pytest.approx(COUNTS[0, 0:4:2] + 1j * COUNTS[0, 1:4:2])


@pytest.mark.parametrize(
    ("change", "samples", "poses", "said"),
    [
        ({}, {"full_scale": 0.0}, {}, r"samples: are whole numbers up to \d+, as a converter"),
        ({"pulse": {"shape": "tone_burst", "carrier_hz": 40e3, "duration_s": 0.2}}, {}, {},
         r"pulse\.duration_s: 0\.2 s is no burst; milliseconds\? then it is 0\.0002"),
        ({"pulse": {"shape": "tone_burst", "carrier_hz": 40.0, "duration_s": 2e-4}}, {}, {},
         r"pulse\.carrier_hz: 40 Hz can be heard; kilohertz\? then it is 40000"),
        ({}, {"sample_rate_hz": 200.0}, {}, r"kilohertz\? then it is 200000"),
        ({}, {"start_delay_s": 0.5}, {}, r"start_delay_s: .* milliseconds\? then it is 0\.0005"),
        ({}, {}, {"time_s": 1e5 + 10.0 * np.arange(PINGS)},
         r"time_s: pings are 10 s apart; milliseconds\?"),
        ({"beam": {"kind": "table", "angles_rad": [0, 20, 40], "gains": [1, 0.5, 0]}}, {}, {},
         r"beam\.angles_rad: go to 40 rad, behind the sensor; degrees\?"),
        ({"beam": {"kind": "linear", "half_angle_rad": 35.0}}, {}, {},
         r"beam\.half_angle_rad: should be less than or equal to 3\.14"),
        ({"poses": {"mount": {"yaw_rad": 90.0}}}, {}, {}, r"poses\.mount\.yaw_rad: .*6\.28"),
        ({"air": {"temperature_c": 293.0}}, {}, {}, r"air\.temperature_c: .* \(is 293"),
        ({}, {}, {"time_s": 1e5 + 100.0 * np.arange(PINGS)},
         r"time_s: pings are 100 s apart; milliseconds\?"),
        ({}, {}, {"yaw_rad": 30.0 * np.arange(PINGS)}, r"yaw_rad: goes to 150 rad.*degrees\?"),
        ({}, {}, {"x_m": 20.0 * np.arange(PINGS)}, r"at 200 m/s; millimetres\?"),
        ({"max_range_m": 6.2}, {}, {},
         r"max_range_m: 6\.2 m cannot be heard .* the whole way taken for the range\?"),
    ],
)  # fmt: skip
def test_wrong_units_are_named(tmp_path, change, samples, poses, said):
    path = described(tmp_path, change, samples, poses)
    with pytest.raises(ConfigurationError, match=said):
        list(imported_traces(path))


def test_units_that_are_meant_are_taken(tmp_path):
    path = described(tmp_path, {"units_checked": True}, poses={"yaw_rad": 30.0 * np.arange(PINGS)})
    assert len(list(imported_traces(path))) == PINGS


@pytest.mark.parametrize(
    ("samples", "poses", "said"),
    [
        ({"path": "none.npz"}, {}, "none.npz: does not exist"),
        ({"path": "pings.mat"}, {}, r"must be a \.npz"),
        ({"name": "counts"}, {}, "has no array 'counts'"),
        ({"path": "pings.npy"}, {}, "does not exist"),
        ({}, {"x_m": np.zeros(3)}, "different lengths"),
        ({"sample_rate_hz": 0.0}, {}, "samples.sample_rate_hz: is missing"),
        ({}, {name: column[:4] for name, column in POSES.items()}, "has 6 pings, and the poses"),
        ({}, {"yaw_rad": np.full(PINGS, np.nan)}, "yaw_rad: must be finite"),
    ],
)
def test_files_that_do_not_fit_are_named(tmp_path, samples, poses, said):
    path = described(tmp_path, samples=samples, poses=poses)
    with pytest.raises((ConfigurationError, FileError), match=said):
        list(imported_traces(path))
