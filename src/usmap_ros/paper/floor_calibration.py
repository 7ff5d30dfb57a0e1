"""A floor that is not the one expected, and what the recording itself says of it."""

from dataclasses import asdict, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.calibration import calibrate
from usmap_ros.evaluation.scoring import score
from usmap_ros.grids import GridGeometry, TruthMap
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.paper.part import Part
from usmap_ros.paper.setting import (
    CARPET,
    CENTRES,
    CONCRETE,
    SHORT_PULSE,
    SINUSOID,
    f1_of_sets,
    hear,
    method,
)
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.fields_of_view import PingViews
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.plotting.style import ROBOTS, new_figure, styled
from usmap_ros.reconstruction.cells import reconstruct_cells
from usmap_ros.reconstruction.reconstructor import reconstruct
from usmap_ros.runs.pipeline import Pipeline

#: What the messages state, and what it really was: a warm day, a carpet, a lower mount.
STATED = Channel(343.0, floor_height_m=0.50, floor_reflectivity=0.9)
TRUE = Channel(349.0, floor_height_m=0.42, floor_reflectivity=0.35)
NOISE_STD = 0.003
POLES = ((1.6, 0.5), (2.3, -0.7), (3.1, 0.3), (3.6, 1.3), (4.2, -0.6))
REFLECTIVITIES = (0.25, 0.35, 0.5, 0.8, 1.0)
PINGS = 40
NAMES = {
    "false_echoes_per_ping": "false echoes a ping",
    "missed_echoes_per_ping": "missed echoes a ping",
    "map_f1": "F1 of the map",
}


def mismatched_floor() -> Part:
    """Compare what is found with the floor as stated and as calibrated from the recording."""
    carpet = _carpet_for_concrete()
    traces = recording()
    calibrated = calibrate(traces).channel(STATED)
    channels = {"stated": STATED, "calibrated": calibrated, "true": TRUE}
    explained = {name: _explained(traces, channel) for name, channel in channels.items()}
    numbers: dict[str, Any] = {"carpet_for_concrete": carpet}
    for name, channel in channels.items():
        numbers[name] = {
            **asdict(channel),
            "floor_model": channel.floor_model.value,
            **explained[name],
        }
    numbers["error_before"] = _errors(STATED)
    numbers["error_after"] = _errors(calibrated)
    with styled():
        figure = new_figure(10.0, 3.6)
        left, middle, right = figure.subplots(1, 3)
        _draw_carpet(left, carpet)
        _draw_errors(middle, numbers)
        _draw_explained(right, explained)
    return Part("beyond_mismatched_floor", numbers, figure)


def recording() -> list[EchoTrace]:
    """Traces of a robot that drives a bend among poles; their channel is the stated one."""
    share = np.linspace(0.0, 1.0, PINGS)
    yaw = 0.25 - 0.5 * share
    x, y = 1.1 * share, 0.1 * np.sin(np.pi * share)
    return [
        hear(
            POLES,
            SHORT_PULSE,
            reflectivities=REFLECTIVITIES,
            channel=TRUE,
            stated=STATED,
            noise_std=NOISE_STD,
            pose=Pose.planar(x[number], y[number], yaw[number]),
            seed=number,
        )
        for number in range(PINGS)
    ]


def _carpet_for_concrete() -> dict[str, Any]:
    """The paper's scene over a carpet, explained by a matrix for concrete and by the right one."""
    trace = hear(CENTRES, SINUSOID, channel=CARPET, stated=CONCRETE)
    right = reconstruct_cells(replace(trace, channel=CARPET), method())
    wrong = reconstruct_cells(trace, method())
    simple = reconstruct_cells(trace, method(), floor=False)
    return {
        name: {"relative_residual": found.relative_residual, "f1": f1_of_sets(found, CENTRES)}
        for name, found in (("carpet", right), ("concrete", wrong), ("no floor", simple))
    }


def _errors(channel: Channel) -> dict[str, float]:
    return {
        "sound_speed_m_s": abs(channel.sound_speed_m_s - TRUE.sound_speed_m_s),
        "floor_height_m": abs(channel.floor_height_m - TRUE.floor_height_m),
        "floor_reflectivity": abs(channel.floor_reflectivity - TRUE.floor_reflectivity),
    }


def _explained(traces: list[EchoTrace], channel: Channel) -> dict[str, float]:
    """How well echoes and map agree with the poles when `channel` is believed."""
    pipeline = Pipeline(PipelineParameters())
    false, missed, errors, residuals = 0, 0, [], []
    cones = []
    for trace in traces:
        told = replace(trace, channel=channel)
        cone = reconstruct(told, pipeline.parameters.reconstruction).cone
        pipeline.fuse(cone)
        cones.append(cone)
        truth_m = _heard_ranges_m(trace)
        apart = np.abs(cone.ranges_m[:, np.newaxis] - truth_m)
        false += int(np.count_nonzero(apart.min(axis=1, initial=np.inf) > 0.1))
        missed += int(np.count_nonzero(apart.min(axis=0, initial=np.inf) > 0.1))
        nearest = apart.min(axis=0, initial=np.inf)
        errors.extend(nearest[nearest <= 0.1])
        residuals.append(cone.residual)
    return {
        "false_echoes_per_ping": false / len(traces),
        "missed_echoes_per_ping": missed / len(traces),
        "median_range_error_m": float(np.median(errors)),
        "relative_residual": float(np.mean(residuals)),
        "map_f1": score(pipeline.occupancy_map(), _truth(), PingViews.of(cones)).f1,
    }


def _truth() -> TruthMap:
    """Cells in which the poles stand."""
    resolution_m = PipelineParameters().mapping.resolution_m
    geometry = GridGeometry(
        resolution_m, (0.0, -2.0), (round(4.0 / resolution_m), round(5.0 / resolution_m))
    )
    places = np.floor((np.array(POLES) - geometry.origin_m) / resolution_m).astype(int)
    occupied = np.zeros(geometry.shape, dtype=np.bool_)
    occupied[places[:, 1], places[:, 0]] = True
    return TruthMap(geometry, occupied)


def _heard_ranges_m(trace: EchoTrace) -> FloatArray:
    """Ranges of the poles well inside the cone."""
    ranges_m, bearings_rad = trace.pose.polar(np.array(POLES))
    well_inside: FloatArray = ranges_m[np.abs(bearings_rad) < np.deg2rad(33.0)]
    return well_inside


def _draw_carpet(axes: Axes, carpet: dict[str, Any]) -> None:
    names = ["no floor", "concrete", "carpet"]
    place = np.arange(len(names))
    axes.bar(
        place - 0.2,
        [carpet[name]["relative_residual"] for name in names],
        0.38,
        color=ROBOTS[1],
        label="relative residual",
    )
    axes.bar(place + 0.2, [carpet[name]["f1"] for name in names], 0.38, color=ROBOTS[0], label="F1")
    axes.set_xticks(place, names)
    axes.set(xlabel="floor that Φ believes in", ylabel="share", ylim=(0.0, 1.25))
    axes.set_title("The scene of figure 8, on carpet")
    axes.legend(loc="upper left", ncols=2)


def _draw_errors(axes: Axes, numbers: dict[str, Any]) -> None:
    truth = asdict(TRUE)
    names = {
        "sound_speed_m_s": "sound speed",
        "floor_height_m": "floor height",
        "floor_reflectivity": "reflectivity",
    }
    place = np.arange(len(names))
    for offset, key, color in ((-0.2, "error_before", ROBOTS[1]), (0.2, "error_after", ROBOTS[0])):
        errors = [100.0 * numbers[key][name] / truth[name] for name in names]
        bars = axes.bar(place + offset, errors, 0.38, color=color, label=key.replace("error_", ""))
        axes.bar_label(
            bars,
            [f"{error:.2g} %" if error < 10 else f"{error:.0f} %" for error in errors],
            fontsize=7,
        )
    axes.set_xticks(place, list(names.values()))
    axes.set(ylabel="error (%)", yscale="log", title="Calibrated from the recording")
    axes.margins(y=0.2)
    axes.legend()


def _draw_explained(axes: Axes, explained: dict[str, dict[str, float]]) -> None:
    place = np.arange(len(explained))
    for offset, key, color in (
        (-0.27, "false_echoes_per_ping", ROBOTS[1]),
        (0.0, "missed_echoes_per_ping", ROBOTS[4]),
        (0.27, "map_f1", ROBOTS[2]),
    ):
        values = [one[key] for one in explained.values()]
        bars = axes.bar(place + offset, values, 0.25, color=color, label=NAMES[key])
        axes.bar_label(bars, fmt="%.2f", fontsize=7)
    axes.set_xticks(place, list(explained))
    axes.set(ylabel="per ping, or F1", title="Echoes and map with it")
    axes.set_xlabel("sound speed and floor")
    axes.margins(y=0.25)
    axes.legend(loc="upper right")
