"""A calibration in words, and as a parameter file."""

from typing import Any

import numpy as np
import yaml

from usmap_ros.calibration.pulse import MeasuredPulse
from usmap_ros.calibration.result import Calibration, Estimate
from usmap_ros.calibration.ringing import Ringing

#: Digits behind the point, unit and name of each quantity.
_SHOWN = {
    "gain": (1, "dB", "gain"),
    "range_offset_m": (1, "mm", "range offset"),
    "sound_speed_m_s": (2, "m/s", "sound speed"),
    "floor_height_m": (4, "m", "floor height"),
    "floor_reflectivity": (3, "", "floor reflectivity"),
}
#: A natural logarithm of amplitude in dB.
_DECIBELS = 20.0 / np.log(10.0)


def summary(calibration: Calibration) -> dict[str, str]:
    """What was found of each quantity, one line each: value ± standard deviation, or why not."""
    lines = {
        _SHOWN[name][2]: _line(name, estimate) for name, estimate in calibration.estimates().items()
    }
    if calibration.floor_height_m.is_known and calibration.floor_height_m.value > 0.0:
        lines["floor model"] = calibration.floor_model.value
    if calibration.pulse is not None:
        lines["pulse"] = _pulse_line(calibration.pulse)
    if calibration.ringing is not None:
        lines["ringing"] = _ringing_line(calibration.ringing)
    return lines


def as_json(calibration: Calibration) -> dict[str, Any]:
    """All figures, ready to become JSON; None where there is none."""
    figures: dict[str, Any] = {
        name: {
            "value": _finite(estimate.value),
            "std": _finite(estimate.std),
            "known": estimate.is_known,
            "why_unknown": estimate.why_unknown,
        }
        for name, estimate in calibration.estimates().items()
    }
    counts = {name: getattr(calibration, name) for name in ("pings", "echoes", "objects")}
    figures["floor_model"] = calibration.floor_model.value
    if calibration.pulse is not None:
        figures["pulse"] = {
            "measured": calibration.pulse.is_known,
            "residual": calibration.pulse.residual,
            "stated_residual": calibration.pulse.stated_residual,
            "model_error": calibration.pulse.model_error,
            "echoes": calibration.pulse.echoes,
        }
    return counts | figures


def parameter_file(calibration: Calibration, source: str, content: dict[str, Any]) -> str:
    """Text of a parameter file with what is told, behind comments that say how well.

    Parameters
    ----------
    calibration : Calibration
        What was found.
    source : str
        The recording's name.
    content : dict
        Other parameters that the file is to hold, as parsed from YAML.
    """
    found = calibration.reconstruction()
    found["correction"] = {
        name: float(f"{value:.6g}") if isinstance(value, float) else value
        for name, value in found["correction"].items()
    }
    group = {**content.get("reconstruction", {}), **found}
    lines = [
        f"# Calibrated from {source}: {calibration.pings} pings, {calibration.echoes} echoes of"
        f" {calibration.objects} objects",
        *(f"# {name}: {line}" for name, line in summary(calibration).items()),
    ]
    # Lists of numbers on lines of their own would be hundreds.
    body = yaml.safe_dump(
        {**content, "reconstruction": group}, sort_keys=False, default_flow_style=None, width=100
    )
    return "\n".join(lines) + "\n" + body


def _line(name: str, estimate: Estimate) -> str:
    digits, unit, _ = _SHOWN[name]
    value, std = estimate.value, estimate.std
    if not np.isfinite(value):
        return estimate.why_unknown
    if name == "gain":
        factor = f"{value:.4g}, "
        value, std = _DECIBELS * np.log(value), _DECIBELS * std
    else:
        factor = ""
    if unit == "mm":
        value, std = 1e3 * value, 1e3 * std
    text = f"{factor}{value:.{digits}f} ± {std:.{digits}f} {unit}".rstrip()
    if name == "floor_height_m" and estimate.is_known and value == 0.0:
        return "no floor is heard, although messages state one"
    return text if estimate.is_known else f"{text}; left as stated: {estimate.why_unknown}"


def _pulse_line(pulse: MeasuredPulse) -> str:
    stated = f"the stated one leaves {pulse.stated_residual:.2f} of an echo"
    if not pulse.is_known:
        return f"as stated; {stated}"
    return (
        f"measured on {pulse.echoes} echoes; {stated}, the measured one {pulse.residual:.2f}; model"
        f" error {pulse.model_error:.2f}"
    )


def _ringing_line(ringing: Ringing) -> str:
    ranges = ", ".join(f"{one:.3f}" for one in ringing.ranges_m)
    return f"heard in every ping, as recorded at {ranges} m"


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
