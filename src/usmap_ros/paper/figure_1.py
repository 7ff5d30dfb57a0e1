"""Figure 1: a robot and four objects, and two robots that see two of them both."""

from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usmap_ros.grids import OCCUPIED_PROBABILITY, OccupancyMap
from usmap_ros.mapping.candidates import CandidateCells, candidate_cells
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.paper.drawing import COEFFICIENT, annotate, draw_cone_edge, draw_objects, finish_map
from usmap_ros.paper.part import Part, statement
from usmap_ros.paper.setting import AIR, SHORT_PULSE, Points, hear
from usmap_ros.parameters import MappingParameters, PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.plotting.style import PROBABILITY, RECONSTRUCTION, ROBOTS, SIGNAL, new_figure, styled
from usmap_ros.runs.pipeline import Pipeline

#: Two that both robots see, one that only the first sees, and one that only the second sees.
OBJECTS: Points = ((2.03, 1.23), (2.91, 1.72), (1.5, 0.35), (0.9, 3.0))
NUMBERS = ("1", "2", "3", "4")
POSES = (Pose.planar(0.0, 0.6, np.deg2rad(20.0)), Pose.planar(3.9, 0.2, np.deg2rad(130.0)))
ROBOT_NAMES = ("robot 1", "robot 2")
NOISE_STD = 0.003
LISTENING = replace(SHORT_PULSE, max_range_m=4.5)
#: An echo is an object's if it is as far away.
SAME_RANGE_M = 0.05
#: Cells about an object that count as the object, and those that may not be called a ghost.
NEAR_CELLS, GHOST_CELLS = 1, 3
#: A prior of one cell in two hundred, about the share that the objects and their room take up.
MAPPING = MappingParameters(prior=0.005)


def single_robot() -> Part:
    """Draw figure 1a: what is in the cone of one robot, and the echoes that come back."""
    trace = hear(OBJECTS, LISTENING, noise_std=NOISE_STD, pose=POSES[0])
    cone = Pipeline().reconstruct(trace)
    seen, ranges_m = _in_cone(POSES[0]), POSES[0].polar(np.array(OBJECTS))[0]
    apart_m = np.abs(cone.ranges_m[:, np.newaxis] - ranges_m[seen])
    numbers = {
        "objects_m": [list(point) for point in OBJECTS],
        "echo_ranges_m": cone.ranges_m.tolist(),
        "caption": {
            "three of four objects are in the cone": statement(
                (len(seen), seen.sum()) == (4, 3), objects=len(seen), in_cone=int(seen.sum())
            ),
            "those three return echoes": statement(
                len(cone.ranges_m) == seen.sum() and (apart_m.min(axis=0) < SAME_RANGE_M).all(),
                echoes=len(cone.ranges_m),
                range_errors_m=apart_m.min(axis=0).tolist(),
            ),
        },
    }
    return Part("figure_1a_single_robot", numbers, _single_robot_figure(trace, cone))


def _single_robot_figure(trace: EchoTrace, cone: EchoCone) -> Figure:
    with styled():
        figure = new_figure(9.0, 4.0)
        plan, signal = figure.subplots(1, 2, width_ratios=[1.0, 1.3])
        draw_cone_edge(plan, POSES[0], LISTENING.max_range_m, ROBOTS[0], "robot")
        draw_objects(plan, OBJECTS)
        _number_objects(plan)
        finish_map(plan, "A robot and four objects")
        plan.legend(loc="upper right", markerscale=0.5)
        seen, ranges_m = _in_cone(POSES[0]), POSES[0].polar(np.array(OBJECTS))[0]
        range_of_sample_m = 0.5 * AIR.sound_speed_m_s * trace.sample_times_s()
        signal.plot(range_of_sample_m, np.abs(trace.signal()), color=SIGNAL, label="received")
        signal.vlines(
            cone.ranges_m, 0.0, cone.amplitudes, color=RECONSTRUCTION, label="echoes found"
        )
        for number in np.flatnonzero(seen):
            echo = int(np.argmin(np.abs(cone.ranges_m - ranges_m[number])))
            signal.annotate(
                f"object {NUMBERS[number]}",
                (cone.ranges_m[echo], cone.amplitudes[echo]),
                (0, 6),
                textcoords="offset points",
                ha="center",
            )
        signal.set(xlabel="range (m)", ylabel="amplitude")
        signal.margins(y=0.12)
        signal.set_title("What comes back")
        signal.legend()
    return figure


def two_robots() -> Part:
    """Draw figure 1b: what one ping of each robot leaves open, and the map of both."""
    cones = [
        Pipeline().reconstruct(hear(OBJECTS, LISTENING, noise_std=NOISE_STD, pose=pose, seed=seed))
        for seed, pose in enumerate(POSES)
    ]
    candidates = [candidate_cells(cone, MAPPING) for cone in cones]
    occupancy = _fused(cones)
    seen = np.array([_in_cone(pose) for pose in POSES])
    certain = certainty(occupancy, seen[0] & seen[1])
    numbers: dict[str, Any] = {"both_robots": certain}
    for name, cells, own in zip(ROBOT_NAMES, candidates, seen, strict=True):
        numbers[name.replace(" ", "_")] = ambiguity(cells, int(own.sum()))
    numbers["caption"] = {
        "two of the objects are seen by both": statement(
            (seen[0] & seen[1]).sum() == 2,
            seen_by=[[NUMBERS[one] for one in np.flatnonzero(own)] for own in seen],
        ),
        "the symmetry of a single measurement is broken": statement(
            certain["least_where_both_see"] > 5.0 * certain["most_elsewhere"],
            probability_at_those_two=certain["least_where_both_see"],
            probability_elsewhere=certain["most_elsewhere"],
        ),
    }
    return Part("figure_1b_two_robots", numbers, _figure(candidates, occupancy, numbers))


def _in_cone(pose: Pose) -> BoolArray:
    """Which objects are in the cone of a transducer there."""
    ranges_m, bearings_rad = pose.polar(np.array(OBJECTS))
    beam = hear([], LISTENING).transducer.beam
    heard: BoolArray = (ranges_m <= LISTENING.max_range_m) & (beam.gain(bearings_rad) > 0.0)
    return heard


def _number_objects(axes: Axes) -> None:
    for number, point in zip(NUMBERS, OBJECTS, strict=True):
        axes.annotate(number, point, (9, 5), textcoords="offset points", fontsize=8, zorder=7)


def _figure(
    candidates: list[CandidateCells], occupancy: OccupancyMap, numbers: dict[str, Any]
) -> Figure:
    with styled():
        figure = new_figure(11.0, 4.4)
        panels = figure.subplots(1, 3, sharex=True, sharey=True)
        images = [_draw_candidates(panels[robot], cells) for robot, cells in enumerate(candidates)]
        images.append(_draw_map(panels[2], occupancy))
        for robot, (name, pose) in enumerate(zip(ROBOT_NAMES, POSES, strict=True)):
            for axes in (panels[robot], panels[2]):
                draw_cone_edge(axes, pose, LISTENING.max_range_m, ROBOTS[robot], name)
            alike = numbers[name.replace(" ", "_")]["candidates_per_object"]
            annotate(panels[robot], f"{alike:.0f} candidate cells for each of 3 objects")
        certain = numbers["both_robots"]
        annotate(
            panels[2],
            f"where both see {certain['least_where_both_see']:.2f} and more,"
            f" elsewhere {certain['most_elsewhere']:.2f} at most",
        )
        titles = [*(f"What {name} hears" for name in ROBOT_NAMES), "The map of both"]
        for axes, title in zip(panels, titles, strict=True):
            draw_objects(axes, OBJECTS)
            _number_objects(axes)
            finish_map(axes, title)
            axes.legend(loc="lower left", markerscale=0.5)
        panels[0].set(xlim=(-0.9, 4.6), ylim=(-1.6, 5.0))
        likelihood = "likelihood, relative to the best"
        figure.colorbar(images[0], ax=panels[:2], label=likelihood, shrink=0.8)
        figure.colorbar(images[2], ax=panels[2], label="probability of being occupied", shrink=0.8)
    return figure


def ambiguity(cells: CandidateCells, objects: int) -> dict[str, float]:
    """How many cells one ping leaves as candidates for the objects that it reached."""
    return {
        "objects": objects,
        "candidate_cells": len(cells.likelihood),
        "candidates_per_object": len(cells.likelihood) / objects,
        "likely_cells": int(np.count_nonzero(cells.likelihood >= 0.5)),
    }


def certainty(occupancy: OccupancyMap, by_both: BoolArray) -> dict[str, float]:
    """Probability at objects that both see and that one sees, and away from all of them."""
    # Cells that were not observed are unknown, whatever evidence they hold already.
    probability = np.where(occupancy.observed, occupancy.probability(), 0.0)
    distance = _distances_to_objects(occupancy)
    elsewhere = (distance > GHOST_CELLS).all(axis=0)
    at_objects = np.array([probability[near <= NEAR_CELLS].max() for near in distance])
    return {
        "least_where_both_see": float(at_objects[by_both].min()),
        "most_where_one_sees": float(at_objects[~by_both].max()),
        "most_elsewhere": float(probability[elsewhere].max()),
        "occupied_cells_elsewhere": int(
            np.count_nonzero(probability[elsewhere] >= OCCUPIED_PROBABILITY)
        ),
    }


def _fused(cones: list[EchoCone]) -> OccupancyMap:
    pipeline = Pipeline(PipelineParameters(mapping=MAPPING))
    for cone in cones:
        pipeline.fuse(cone)
    return pipeline.occupancy_map()


def _distances_to_objects(occupancy: OccupancyMap) -> FloatArray:
    """Chebyshev distance of every cell to each object's cell, shape (objects, rows, columns)."""
    geometry = occupancy.geometry
    rows, columns = np.indices(geometry.shape)
    places = np.floor((np.array(OBJECTS) - geometry.origin_m) / geometry.resolution_m)
    distances: FloatArray = np.maximum(
        np.abs(columns - places[:, 0, np.newaxis, np.newaxis]),
        np.abs(rows - places[:, 1, np.newaxis, np.newaxis]),
    )
    return distances


def _draw_candidates(axes: Axes, cells: CandidateCells) -> Any:
    order = np.argsort(cells.likelihood)
    x, y = cells.centers_m[order].T
    return axes.scatter(
        x, y, c=cells.likelihood[order], s=6.0, marker="s", cmap=COEFFICIENT, vmin=0.0, vmax=1.0
    )


def _draw_map(axes: Axes, occupancy: OccupancyMap) -> Any:
    shown = np.ma.masked_where(~occupancy.observed, occupancy.probability())
    return axes.imshow(
        shown,
        extent=occupancy.geometry.extent_m,
        origin="lower",
        cmap=PROBABILITY,
        vmin=0.0,
        vmax=1.0,
        interpolation="nearest",
    )
