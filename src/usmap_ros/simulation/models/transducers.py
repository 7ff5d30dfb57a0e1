"""Transducers in a scenario: the pulse they send, their beam, and their receiver."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.bounds import QUALITY
from usmap_ros.errors import MalformedMessageError
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ParameterGroup, quantity
from usmap_ros.pings.preparation.received_pulse import driven_resonators
from usmap_ros.pings.trace import Encoding
from usmap_ros.simulation.imperfections import Imperfections, Muting, RingDown
from usmap_ros.simulation.polyline import Coordinate
from usmap_ros.simulation.receiver import Converter, Receiver


class ResonanceModel(ParameterGroup):
    """A resonance of the transducer: it rounds off the burst, and rings."""

    frequency_hz: float = quantity(..., "Where it is.", "Hz", gt=0.0, le=1e7)
    quality: float = quantity(..., "Its quality factor.", ge=QUALITY.least, le=QUALITY.greatest)


class PulseModel(ParameterGroup):
    """The pulse that a transducer emits."""

    shape: Literal["square", "tone_burst", "hann_burst", "chirp"] = quantity(
        "hann_burst",
        "A square pulse without carrier, a sine under a window, or a linear chirp under a Hann"
        " window.",
    )
    carrier_hz: float = quantity(
        50_000.0,
        "Carrier frequency, at the middle of a chirp; ignored for a square pulse.",
        "Hz",
        gt=0.0,
        le=1e7,
    )
    duration_s: float = quantity(0.00032, "Length of the window.", "s", gt=0.0, le=1.0)
    sweep_hz: float = quantity(
        0.0,
        "How far a chirp's frequency rises from beginning to end, negative if it falls; a chirp"
        " needs it, and nothing else has it.",
        "Hz",
        ge=-1e7,
        le=1e7,
    )

    resonances: list[ResonanceModel] = quantity(
        [],
        "What transmitter and receiver make of the burst; messages state the burst alone.",
        max_length=2,
    )

    def build(self) -> Pulse:
        """The pulse itself."""
        shape = PulseShape[self.shape.upper()]
        carrier_hz = 0.0 if shape is PulseShape.SQUARE else self.carrier_hz
        pulse = Pulse(shape, carrier_hz, self.duration_s, self.sweep_hz)
        if not self.resonances:
            return pulse
        resonances = tuple((one.frequency_hz, one.quality) for one in self.resonances)
        return replace(pulse, profile=driven_resonators(pulse, resonances))

    @model_validator(mode="after")
    def _chirp_has_its_sweep(self) -> PulseModel:
        if (self.shape == "chirp") != (self.sweep_hz != 0.0):
            raise ValueError("sweep_hz: a chirp needs one that is not 0, and nothing else has one")
        if self.shape == "square" and self.resonances:
            raise ValueError("resonances: a square pulse has no carrier that could resonate")
        return self


class LinearBeamModel(ParameterGroup):
    """Gain that falls linearly to 0, as the paper has it."""

    kind: Literal["linear"] = quantity("linear", "Kind of pattern.")
    half_angle_rad: float = quantity(
        0.6981317, "Angle off axis at which the gain is 0.", "rad", gt=0.0, le=np.pi
    )

    def build(self) -> BeamPattern:
        """The pattern itself."""
        return BeamPattern.linear(self.half_angle_rad)


class PistonBeamModel(ParameterGroup):
    """Gain of a circular piston in a baffle."""

    kind: Literal["piston"] = quantity(..., "Kind of pattern.")
    radius_m: float = quantity(0.0075, "Radius of the piston.", "m", gt=0.0, le=1.0)
    wavelength_m: float = quantity(0.00686, "Of the carrier.", "m", gt=0.0, le=10.0)

    def build(self) -> BeamPattern:
        """The pattern itself."""
        return BeamPattern.circular_piston(self.radius_m, self.wavelength_m)


class SensComp600BeamModel(ParameterGroup):
    """Gain of a transducer like the SensComp 600 at 50 kHz."""

    kind: Literal["senscomp_600"] = quantity(..., "Kind of pattern.")

    def build(self) -> BeamPattern:
        """The pattern itself."""
        return BeamPattern.senscomp_600()


class TableBeamModel(ParameterGroup):
    """Gain as measured."""

    kind: Literal["table"] = quantity(..., "Kind of pattern.")
    angles_rad: list[float] = quantity(..., "Ascending from 0.", "rad", min_length=2)
    gains: list[float] = quantity(
        ..., "Two-way amplitude gain at those angles, 1 on axis.", "", min_length=2
    )

    def build(self) -> BeamPattern:
        """The pattern itself."""
        return BeamPattern(np.array(self.angles_rad), np.array(self.gains))


BeamModel = Annotated[
    LinearBeamModel | PistonBeamModel | SensComp600BeamModel | TableBeamModel,
    Field(discriminator="kind"),
]


class MountModel(ParameterGroup):
    """Where a transducer sits in its robot's base frame."""

    x_m: float = quantity(0.0, "Forward.", "m", ge=-100.0, le=100.0)
    y_m: float = quantity(0.0, "To the left.", "m", ge=-100.0, le=100.0)
    z_m: float = quantity(0.0, "Above the floor.", "m", ge=0.0, le=100.0)
    yaw_rad: float = quantity(
        0.0, "Direction of the beam axis, to the left.", "rad", ge=-2.0 * np.pi, le=2.0 * np.pi
    )
    pitch_rad: float = quantity(
        0.0, "Of the beam axis, downwards.", "rad", ge=-0.5 * np.pi, le=0.5 * np.pi
    )
    roll_rad: float = quantity(0.0, "About the beam axis.", "rad", ge=-np.pi, le=np.pi)

    def build(self) -> Pose:
        """The pose itself, turned about z, then y, then x as is usual in ROS."""
        position_m = np.array([self.x_m, self.y_m, self.z_m])
        return Pose.turned(position_m, self.yaw_rad, self.pitch_rad, self.roll_rad)


class OwnEchoModel(ParameterGroup):
    """What the sensor's own casing, or its mount, returns of every ping."""

    delay_s: float = quantity(..., "After the start of emission.", "s", gt=0.0, le=1.0)
    amplitude: float = quantity(..., "Of it; an ideal point target at 1 m gives 1.", gt=0.0, le=1e6)


class ReceiverModel(ParameterGroup):
    """What turns sound into samples."""

    encoding: Literal["raw", "envelope", "iq"] = quantity("iq", "What the samples are.")
    sample_rate_hz: float = quantity(25_000.0, "Of samples, or of I/Q pairs.", "Hz", gt=0.0, le=1e8)
    start_delay_s: float = quantity(
        0.0, "From the start of emission to the first sample.", "s", ge=0.0, le=10.0
    )
    noise_std: float = quantity(
        0.01,
        "RMS of the complex baseband noise; an ideal point target at 1 m gives 1.",
        ge=0.0,
        le=1e9,
    )
    converter: Converter | None = quantity(None, "None: exact samples.")
    gain: float = quantity(1.0, "Samples are so many times what they should be.", gt=0.0, le=1e9)
    offset: float = quantity(
        0.0,
        "Added to every sample behind the gain, as by a converter without a sign.",
        ge=-1e9,
        le=1e9,
    )
    latency_s: float = quantity(
        0.0, "How much later than traces say samples show what is heard.", "s", ge=0.0, le=0.1
    )
    blanking_s: float = quantity(
        0.0, "Until then after the emission it is silent.", "s", ge=0.0, le=1.0
    )
    ring_down: RingDown | None = quantity(None, "None: the transmitter is not heard.")
    muting: Muting | None = quantity(None, "None: it listens to the end.")
    own_echoes: list[OwnEchoModel] = quantity(
        [], "What casing and mount return of every ping.", max_length=32
    )

    def build(self) -> Receiver:
        """The receiver itself."""
        beside = Imperfections(
            self.gain,
            self.offset,
            self.latency_s,
            self.ring_down,
            self.blanking_s,
            self.muting,
            tuple((one.delay_s, one.amplitude) for one in self.own_echoes),
        )
        encoding = Encoding[self.encoding.upper()]
        timing = (self.sample_rate_hz, self.start_delay_s)
        return Receiver(encoding, *timing, self.noise_std, self.converter, beside)


class TransducerModel(ParameterGroup):
    """One transducer of a robot."""

    name: str = quantity("sonar", "Its frame is ROBOT/NAME.", pattern=r"^[A-Za-z]\w*$")
    mount: MountModel = quantity(MountModel(), "Where it sits on the robot.")
    pulse: PulseModel = quantity(PulseModel(), "What it emits.")
    beam: BeamModel = quantity(LinearBeamModel(), "Gain off axis.")
    min_range_m: float = quantity(0.2, "Least range that it reports.", "m", ge=0.0, le=1000.0)
    max_range_m: float = quantity(5.0, "Largest range.", "m", gt=0.0, le=1000.0)
    receiver: ReceiverModel = quantity(ReceiverModel(), "Noise, converter and encoding.")
    receiver_offset_m: tuple[Coordinate, Coordinate, Coordinate] = quantity(
        (0.0, 0.0, 0.0),
        "Where its receiving element is, ahead, to the left and upwards of the one that sends.",
        "m",
    )
    emits: bool = quantity(
        True, "False: it only listens, which needs others of its robot that are simultaneous."
    )

    def build(self) -> Transducer:
        """The transducer itself."""
        return Transducer(self.pulse.build(), self.beam.build(), self.min_range_m, self.max_range_m)

    @model_validator(mode="after")
    def _can_exist(self) -> TransducerModel:
        try:
            self.build().validate()
        except MalformedMessageError as error:
            raise ValueError(f"{_KEYS.get(error.field, error.field)}: {error.cause}") from error
        return self


#: Keys of a transducer, by the fields of messages that they set.
_KEYS = {
    "transducer.min_range": "min_range_m",
    "transducer.max_range": "max_range_m",
    "transducer.pulse_duration": "pulse.duration_s",
    "transducer.carrier_frequency": "pulse.carrier_hz",
    "transducer.sweep": "pulse.sweep_hz",
    "transducer.beam_angles": "beam.angles_rad",
    "transducer.beam_gains": "beam.gains",
}
