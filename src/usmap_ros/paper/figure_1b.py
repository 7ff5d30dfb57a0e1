"""Figure 1b: two robots; what each cone leaves open, and the map that both make."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usmap_ros.arrays import FloatArray
from usmap_ros.cone import EchoCone
from usmap_ros.geometry import Pose
from usmap_ros.grids import OCCUPIED_PROBABILITY, OccupancyMap
from usmap_ros.mapping.candidates import CandidateCells, candidate_cells
from usmap_ros.paper.drawing import COEFFICIENT, annotate, draw_cone, draw_objects, finish_map
from usmap_ros.paper.part import Part
from usmap_ros.paper.setting import SHORT_PULSE, Points, hear
from usmap_ros.parameters import MappingParameters, PipelineParameters
from usmap_ros.pipeline import Pipeline
from usmap_ros.plotting.style import PROBABILITY, ROBOTS, new_figure, styled

POLES: Points = ((2.03, 1.23), (2.91, 1.72), (1.32, 1.83), (2.58, 2.53))
POSES = (
    Pose.planar(0.0, 0.6, np.deg2rad(20.0)),
    Pose.planar(3.9, 0.2, np.deg2rad(130.0)),
)
NAMES = ("robot 1", "robot 2")
NOISE_STD = 0.01
LISTENING = replace(SHORT_PULSE, max_range_m=4.0)
#: Cells about a pole that count as the pole, and those that may not be called a ghost.
NEAR_CELLS, GHOST_CELLS = 1, 3
#: A prior of one cell in two hundred, about the share that the poles and their room take up.
MAPPING = MappingParameters(prior=0.005)


def two_robots() -> Part:
    """Draw what one ping of each robot leaves open, and the map of both."""
    cones = [
        Pipeline().reconstruct(hear(POLES, LISTENING, noise_std=NOISE_STD, pose=pose, seed=seed))
        for seed, pose in enumerate(POSES)
    ]
    candidates = [candidate_cells(cone, MAPPING) for cone in cones]
    occupancy = _fused(cones)
    numbers: dict[str, Any] = {"both_robots": certainty(occupancy)}
    for name, cells in zip(NAMES, candidates, strict=True):
        numbers[name.replace(" ", "_")] = ambiguity(cells)
    return Part("figure_1b_two_robots", numbers, _figure(candidates, occupancy, numbers))


def _figure(
    candidates: list[CandidateCells], occupancy: OccupancyMap, numbers: dict[str, Any]
) -> Figure:
    with styled():
        figure = new_figure(11.0, 4.4)
        panels = figure.subplots(1, 3, sharex=True, sharey=True)
        images = [_draw_candidates(panels[robot], cells) for robot, cells in enumerate(candidates)]
        images.append(_draw_map(panels[2], occupancy))
        for robot, (name, pose) in enumerate(zip(NAMES, POSES, strict=True)):
            for axes in (panels[robot], panels[2]):
                draw_cone(axes, pose, LISTENING.max_range_m, ROBOTS[robot], name)
            alike = numbers[name.replace(" ", "_")]["candidates_per_pole"]
            annotate(panels[robot], f"{alike:.0f} candidate cells for each pole")
        seen = numbers["both_robots"]
        annotate(
            panels[2],
            f"poles {seen['least_at_a_pole']:.2f} and more,"
            f" elsewhere {seen['most_elsewhere']:.2f} at most",
        )
        titles = [*(f"What {name} hears" for name in NAMES), "The map of both"]
        for axes, title in zip(panels, titles, strict=True):
            draw_objects(axes, POLES)
            finish_map(axes, title)
            axes.legend(loc="lower left", markerscale=0.5)
        panels[0].set(xlim=(-0.4, 4.4), ylim=(-1.4, 4.6))
        likelihood = "likelihood, relative to the best"
        figure.colorbar(images[0], ax=panels[:2], label=likelihood, shrink=0.8)
        figure.colorbar(images[2], ax=panels[2], label="probability of being occupied", shrink=0.8)
    return figure


def ambiguity(cells: CandidateCells) -> dict[str, float]:
    """How many cells one ping leaves as candidates."""
    likely = int(np.count_nonzero(cells.likelihood >= 0.5))
    return {
        "candidate_cells": len(cells.likelihood),
        "candidates_per_pole": len(cells.likelihood) / len(POLES),
        "likely_cells": likely,
    }


def certainty(occupancy: OccupancyMap) -> dict[str, float]:
    """Least probability at a pole, most of it elsewhere, and the cells called occupied."""
    # Cells that were not observed are unknown, whatever evidence they hold already.
    probability = np.where(occupancy.observed, occupancy.probability(), 0.0)
    distance = _distances_to_poles(occupancy)
    elsewhere = (distance > GHOST_CELLS).all(axis=0)
    at_poles = [probability[near <= NEAR_CELLS].max() for near in distance]
    return {
        "least_at_a_pole": float(min(at_poles)),
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


def _distances_to_poles(occupancy: OccupancyMap) -> FloatArray:
    """Chebyshev distance of every cell to each pole's cell, shape (poles, rows, columns)."""
    geometry = occupancy.geometry
    rows, columns = np.indices(geometry.shape)
    places = np.floor((np.array(POLES) - geometry.origin_m) / geometry.resolution_m)
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
