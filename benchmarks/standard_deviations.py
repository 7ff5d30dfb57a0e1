"""Whether stated standard deviations of ranges and amplitudes are those of the errors.

Simulates lone echoes at random ranges, reconstructs them, and prints the standard deviation of
error over stated deviation: 1 is honest, above it is overconfident. For every encoding, pulse,
sample rate and signal-to-noise ratio of a matched filter.

python benchmarks/standard_deviations.py
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.profile import Profile
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.preparation.received_pulse import driven_resonators
from usmap_ros.pings.trace import EchoTrace, Encoding
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.simulation.receiver import Arrivals, Receiver

SQUARE = Pulse(PulseShape.SQUARE, 0.0, 0.00032)
TONE = Pulse(PulseShape.TONE_BURST, 50_000.0, 0.00032)
#: A burst of no whole number of cycles or samples.
ODD_TONE = Pulse(PulseShape.TONE_BURST, 40_000.0, 0.000413)
HANN = Pulse(PulseShape.HANN_BURST, 50_000.0, 0.00032)
CHIRP = Pulse(PulseShape.CHIRP, 60_000.0, 0.002, 40_000.0)
#: A burst behind two resonators, and told to be that.
RESONANT = replace(
    ODD_TONE, profile=driven_resonators(ODD_TONE, ((40_000.0, 20.0), (40_500.0, 25.0)))
)
_TIME_S = np.arange(0.0, RESONANT.length_s + 0.0005, 5e-6)
#: The same with a reflection off the sensor's housing, as `usmap calibrate` measures it.
MEASURED = replace(
    ODD_TONE,
    profile=Profile.of(
        RESONANT.envelope(_TIME_S) + 0.3j * RESONANT.envelope(_TIME_S - 0.0005), 200_000.0
    ),
)
#: Name, encoding, pulse and sample rates.
RECEPTIONS: list[tuple[str, Encoding, Pulse, tuple[float, ...]]] = [
    ("raw square", Encoding.RAW, SQUARE, (25e3, 122e3)),
    ("raw tone burst", Encoding.RAW, TONE, (122e3, 250e3, 1e6)),
    ("raw odd tone burst", Encoding.RAW, ODD_TONE, (122e3, 1e6)),
    ("raw Hann burst", Encoding.RAW, HANN, (122e3, 250e3, 1e6)),
    ("raw chirp", Encoding.RAW, CHIRP, (250e3, 1e6)),
    ("I/Q tone burst", Encoding.IQ, TONE, (25e3, 50e3)),
    ("I/Q odd tone burst", Encoding.IQ, ODD_TONE, (50e3,)),
    ("I/Q Hann burst", Encoding.IQ, HANN, (25e3, 50e3)),
    ("I/Q chirp", Encoding.IQ, CHIRP, (100e3,)),
    ("raw resonant burst", Encoding.RAW, RESONANT, (200e3,)),
    ("I/Q resonant burst", Encoding.IQ, RESONANT, (25e3,)),
    ("envelope resonant burst", Encoding.ENVELOPE, RESONANT, (25e3,)),
    ("raw measured burst", Encoding.RAW, MEASURED, (200e3,)),
    ("I/Q measured burst", Encoding.IQ, MEASURED, (25e3,)),
    ("envelope measured burst", Encoding.ENVELOPE, MEASURED, (25e3,)),
    ("envelope square", Encoding.ENVELOPE, SQUARE, (25e3,)),
    ("envelope tone burst", Encoding.ENVELOPE, TONE, (25e3, 50e3)),
    ("envelope Hann burst", Encoding.ENVELOPE, HANN, (25e3, 50e3)),
]
#: Energy of the echo over density of the noise, dB.
RATIOS_DB = (20.0, 30.0, 40.0, 60.0)
SPEED_M_S = 343.0


@dataclass(frozen=True)
class Row:
    """Errors over stated deviations of one reception.

    Parameters
    ----------
    name : str
        Encoding and pulse.
    rate_hz, ratio_db : float
        Sample rate, and signal-to-noise ratio behind the matched filter.
    ranges, amplitudes : (echoes,) arrays
        Error over stated standard deviation; infinite where none is stated.
    range_std_m : float
        Median of the stated deviations.
    missed : int
        Traces in which there was no echo, or more than one.
    """

    name: str
    rate_hz: float
    ratio_db: float
    ranges: np.ndarray
    amplitudes: np.ndarray
    range_std_m: float
    missed: int


def row(reception: tuple[str, Encoding, Pulse], rate_hz: float, ratio_db: float, count: int) -> Row:
    """Measure one reception on `count` echoes."""
    name, encoding, pulse = reception
    rng = np.random.default_rng(20)
    found = []
    for trace, range_m, amplitude in traces(encoding, pulse, rate_hz, ratio_db, count, rng):
        cone = reconstruct(trace, ReconstructionParameters()).cone
        if len(cone.ranges_m) == 1:
            found.append(
                (
                    float(cone.ranges_m[0]) - range_m,
                    float(cone.range_stds_m[0]),
                    float(cone.amplitudes[0]) - amplitude,
                    float(cone.amplitude_stds[0]),
                )
            )
    errors = np.array(found).reshape(-1, 4).T
    with np.errstate(divide="ignore"):
        ranges, amplitudes = errors[0] / errors[1], errors[2] / errors[3]
    std_m = float(np.median(errors[1])) if found else float("nan")
    return Row(name, rate_hz, ratio_db, ranges, amplitudes, std_m, count - len(found))


def traces(
    encoding: Encoding,
    pulse: Pulse,
    rate_hz: float,
    ratio_db: float,
    count: int,
    rng: np.random.Generator,
) -> Iterator[tuple[EchoTrace, float, float]]:
    """Traces of a lone echo, with its range (m) and amplitude."""
    beam = BeamPattern.linear()
    transducer = Transducer(pulse, beam, 0.2, 2.5)
    channel = Channel(SPEED_M_S)
    energy = pulse.window(np.linspace(0.0, pulse.length_s, 1001)) ** 2
    samples = float(np.mean(energy)) * pulse.length_s * rate_hz
    if encoding is Encoding.RAW and pulse.has_carrier:
        # Half of the power of a carrier's modulation is in it, and half of the complex noise.
        samples *= 0.5
    # `Receiver` counts the noise of I and Q together; a raw sample has half of its power.
    share = 2.0 if encoding is Encoding.RAW else 1.0
    for _ in range(count):
        range_m = float(rng.uniform(1.0, 2.0))
        amplitude = float(channel.amplitudes(np.array(range_m))[0])
        noise_std = amplitude * np.sqrt(samples * share) * 10.0 ** (-ratio_db / 20.0)
        receiver = Receiver(encoding, rate_hz, 0.0, noise_std)
        duration_s = 2.0 * 2.5 / SPEED_M_S + 2.0 * pulse.length_s
        heard = receiver.receive(
            [Arrivals(pulse, np.array([2.0 * range_m / SPEED_M_S]), np.array([amplitude]))],
            pulse,
            receiver.sample_count(duration_s),
            rng,
        )
        yield (
            EchoTrace(
                stamp_ns=0,
                frame_id="map",
                child_frame_id="sonar",
                pose=Pose.planar(0.0, 0.0, 0.0),
                transducer=transducer,
                channel=channel,
                encoding=encoding,
                sample_rate_hz=rate_hz,
                start_delay_s=0.0,
                noise_std=receiver.stated_noise_std,
                samples=heard,
            ),
            range_m,
            amplitude,
        )


def table(count: int = 200) -> Iterator[Row]:
    """All rows."""
    for name, encoding, pulse, rates_hz in RECEPTIONS:
        for rate_hz in rates_hz:
            for ratio_db in RATIOS_DB:
                yield row((name, encoding, pulse), rate_hz, ratio_db, count)


def spread(deviations: np.ndarray) -> float:
    """Root mean square of errors over stated deviations."""
    return float(np.sqrt(np.mean(deviations**2))) if len(deviations) else float("nan")


def run() -> dict[str, Any]:
    """Smallest and largest spread by reception, over all ratios."""
    by_reception: dict[str, list[Row]] = {}
    for one in table(200):
        by_reception.setdefault(f"{one.name}, {one.rate_hz / 1e3:g} kS/s", []).append(one)
    return {
        name: f"range {_extent([spread(one.ranges) for one in rows])},"
        f" amplitude {_extent([spread(one.amplitudes) for one in rows])}"
        for name, rows in by_reception.items()
    }


def _extent(values: list[float]) -> str:
    return f"{min(values):.2f} to {max(values):.2f}"


def main() -> None:
    """Print the whole table."""
    print(f"{'':20} {'kS/s':>6} {'dB':>4} {'range':>7} {'amplitude':>9} {'std (mm)':>9} missed")
    for one in table(int(sys.argv[1]) if len(sys.argv) > 1 else 200):
        print(
            f"{one.name:20} {one.rate_hz / 1e3:6g} {one.ratio_db:4g} {spread(one.ranges):7.2f}"
            f" {spread(one.amplitudes):9.2f} {1e3 * one.range_std_m:9.3f} {one.missed:6d}"
        )


if __name__ == "__main__":
    main()
