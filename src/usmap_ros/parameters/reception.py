"""Parameters of what traces do not say of themselves, or say wrongly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from usmap_ros.bounds import CARRIER, QUALITY, Bound
from usmap_ros.parameters.fields import ParameterGroup, quantity


def _listed(values: Any) -> Any:
    """Numbers as a list: ROS has arrays of its own."""
    return list(values) if isinstance(values, Sequence) and not isinstance(values, str) else values


#: A list of at least one number, since ROS does not know of what an empty one would be.
Numbers = Annotated[list[float], BeforeValidator(_listed), Field(min_length=1)]


class CorrectionParameters(ParameterGroup):
    """What traces state or contain that is off, and is set right before all else."""

    gain: float = quantity(
        1.0,
        "Amplitude in the samples of an echo of which the truth is 1; samples are divided by it.",
        gt=0.0,
        le=1e12,
    )
    noise_factor: float = quantity(
        1.0,
        "Noise over what traces state of it; 1: learnt of each transducer, where it is more.",
        ge=1.0,
        le=1e6,
    )
    range_offset_m: float = quantity(
        0.0, "By how much ranges come out too long; it is taken off.", "m", ge=-10.0, le=10.0
    )
    sound_speed_m_s: float = quantity(
        0.0, "Sound speed; 0: as traces state it.", "m/s", ge=0.0, le=10_000.0
    )
    floor_height_m: float = quantity(
        -1.0,
        "Of the transducer above a reflecting floor, 0 for none; below 0: as traces state it.",
        "m",
        ge=-1.0,
        le=1000.0,
    )
    floor_reflectivity: float = quantity(
        -1.0, "Of the floor; below 0: as traces state it.", ge=-1.0, le=1.0
    )
    floor_model: Literal["image", "corner"] = quantity(
        "image",
        "How the floor returns sound: by an object's mirror image below it, as in the paper, or by"
        " the corner between it and objects that stand upright on it.",
    )


class PulseParameters(ParameterGroup):
    """How an echo looks as received, where transducers do not follow the stated burst."""

    kind: Literal["stated", "resonant", "measured"] = quantity(
        "stated",
        "Like the burst that traces state; like what one or two resonators make of it; or as"
        " measured, which `usmap calibrate` does.",
    )
    learn: bool = quantity(
        True,
        "Whether a stated pulse gives way to one that is learnt, for each transducer, from its own"
        " loud echoes, where that explains them much better.",
    )
    resonances_hz: Numbers = quantity(
        [0.0], "Of resonant pulses: resonance of one or two resonators.", "Hz", max_length=2
    )
    qualities: Numbers = quantity(
        [0.0], "Of resonant pulses: quality factor of each resonator.", max_length=2
    )
    template_rate_hz: float = quantity(
        0.0, "Of measured pulses: rate of the template's values.", "Hz", ge=0.0, le=1e8
    )
    template_i: Numbers = quantity(
        [0.0],
        "Of measured pulses: the echo's envelope over the carrier from its beginning on, in phase;"
        " in any units.",
    )
    template_q: Numbers = quantity(
        [0.0], "Of measured pulses: the same in quadrature, as many values."
    )

    @model_validator(mode="after")
    def _is_complete(self) -> PulseParameters:
        if self.kind == "resonant":
            if len(self.resonances_hz) != len(self.qualities):
                raise ValueError("qualities: need one for each of resonances_hz")
            _check_within("resonances_hz", self.resonances_hz, CARRIER)
            _check_within("qualities", self.qualities, QUALITY)
        if self.kind == "measured":
            if len(self.template_i) != len(self.template_q) or len(self.template_i) < 4:
                raise ValueError("template_i: and template_q need four values or more each")
            if not any(self.template_i) and not any(self.template_q):
                raise ValueError("template_i: and template_q are nothing but zeros")
            if self.template_rate_hz <= 0.0:
                raise ValueError("template_rate_hz: must be above 0")
        return self


def _check_within(name: str, values: list[float], bound: Bound) -> None:
    if not all(bound.least <= value <= bound.greatest for value in values):
        unit = f" {bound.unit}" if bound.unit else ""
        raise ValueError(f"{name}: must be {bound.least:g} to {bound.greatest:g}{unit}")


class RingingParameters(ParameterGroup):
    """What a transducer hears of itself in every ping, behind its least range."""

    ranges_m: Numbers = quantity(
        [0.0],
        "Where it is heard, as echoes that are none; `usmap calibrate` finds them. Echoes there"
        " that are no louder are dropped.",
        "m",
    )
    amplitudes: Numbers = quantity([0.0], "How loud, one for each; 0: nothing is heard.")
    waveform: Numbers = quantity(
        [0.0],
        "The same sample by sample, as in traces once they are corrected, I and Q in turn: it is"
        " taken off those whose samples are taken at the same times.",
    )
    waveform_rate_hz: float = quantity(
        0.0, "Rate of the waveform's samples, or pairs; 0: there is none.", "Hz", ge=0.0, le=1e8
    )
    waveform_start_s: float = quantity(
        0.0, "Of its first one, after the start of emission.", "s", ge=-1.0, le=100.0
    )
    learn: bool = quantity(
        True,
        "Whether it is looked for in the first traces of each transducer that moves, where nothing"
        " is stated.",
    )

    @model_validator(mode="after")
    def _has_pairs(self) -> RingingParameters:
        if len(self.ranges_m) != len(self.amplitudes):
            raise ValueError("amplitudes: need one for each of ranges_m")
        if min(self.amplitudes) < 0.0:
            raise ValueError("amplitudes: must not be below 0")
        if any(self.waveform) != bool(self.waveform_rate_hz):
            raise ValueError("waveform_rate_hz: needs a waveform, and a waveform needs it")
        return self
