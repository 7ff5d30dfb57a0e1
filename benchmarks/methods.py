"""Ways of making a map from a recording, each a row of the table of scores."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from parts import PARTS, Instead, left_out
from recordings import Cones

from usmap_ros.grids import GridGeometry, OccupancyMap
from usmap_ros.io.yaml_files import validated
from usmap_ros.mapping.joint import estimate, explanation
from usmap_ros.mapping.joint.free_space import free_space
from usmap_ros.parameters import PipelineParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.runs.pipeline import Pipeline
from usmap_ros.runs.poses import PoseRun


@dataclass(frozen=True)
class Method:
    """A way of making a map.

    Parameters
    ----------
    shown : str
        In words.
    settings : dict
        Parameters other than their defaults, such as ``{"mapping.occlusion": False}``.
    merges_by_maximum : bool
        Whether each robot has a map of its own, and of their maps the cells count that are surest
        to be occupied.
    trusted_axes : tuple of int
        Rows of poses' covariance (x, y, z, and turns about them) that are taken to be exact,
        whatever it says.
    instead : tuple of Instead
        What stands in the places of parts of the product, see `parts`.
    live_every : int
        Pings from one live map to the next, of which the one after the last ping counts; 0: the
        map is made when all pings are there.
    """

    shown: str
    settings: dict[str, Any] = field(default_factory=dict)
    merges_by_maximum: bool = False
    trusted_axes: tuple[int, ...] = ()
    instead: tuple[Instead, ...] = ()
    live_every: int = 0

    def parameters(self) -> PipelineParameters:
        """The defaults with the method's own settings.

        Raises
        ------
        ConfigurationError
            If there is no such parameter, or its value is out of range.
        """
        content: dict[str, dict[str, Any]] = defaultdict(dict)
        for key, value in self.settings.items():
            group, _, name = key.partition(".")
            content[group][name] = value
        return validated(f"method '{self.shown}'", PipelineParameters, dict(content))

    def map(self, cones: Cones) -> OccupancyMap:
        """The map of a recording."""
        parameters = self.parameters()
        if self.trusted_axes:
            cones = [(topic, _certain(cone, self.trusted_axes)) for topic, cone in cones]
        if self.merges_by_maximum:
            topics = sorted({topic for topic, _ in cones})
            return _max_merged(
                [_fused([one for one in cones if one[0] == topic], parameters) for topic in topics]
            )
        with left_out(self.instead):
            return _fused(cones, parameters, self.live_every)


#: The product with one of its parts left out, to see what each is worth.
ABLATIONS = {
    f"no_{name}": Method(part.shown, part.settings, instead=part.instead)
    for name, part in PARTS.items()
}

#: Everything that is done until it has settled, or so many times, so many times whether or not.
TWENTY: tuple[Instead, ...] = (
    (estimate, "SETTLED", -1.0),
    (estimate, "FIRST_SWEEPS", (20, 20, 20)),
    (explanation, "ROUNDS", 20),
    (estimate, "ALL_ROUNDS", 20),
    (estimate, "WALL_SHADOWS", 20),
    (free_space, "FREE_ROUNDS", 20),
)

#: What shows whether maps have converged, offline and live.
CONVERGENCE = {
    "twenty": Method("twenty rounds of each kind", instead=TWENTY),
    # Three robots ping ten times a second each.
    "live": Method("live, at the last ping", live_every=30),
}

METHODS = {
    "ours": Method("ours"),
    **ABLATIONS,
    **CONVERGENCE,
    "no_covariance": Method("ours, poses' covariance ignored", trusted_axes=(0, 1, 5)),
    "no_heading": Method("ours, headings taken to be exact", trusted_axes=(5,)),
    "additive": Method("additive log-odds", {"mapping.method": "additive"}),
    "range_only": Method(
        "range only (nav2's model)", {"mapping.method": "range_only", "poses.use": "told"}
    ),
    "max_merging": Method("robots' maps merged by maximum", merges_by_maximum=True),
    "paper": Method(
        "the paper's cells, additive",
        {"reconstruction.dictionary": "cells", "mapping.method": "additive"},
    ),
}


def _certain(cone: EchoCone, axes: tuple[int, ...]) -> EchoCone:
    """The same from a pose that is thought to have no error along some axes."""
    covariance = cone.pose.covariance.copy()
    covariance[list(axes), :] = 0.0
    covariance[:, list(axes)] = 0.0
    return replace(cone, pose=replace(cone.pose, covariance=covariance))


def _fused(cones: Cones, parameters: PipelineParameters, live_every: int = 0) -> OccupancyMap:
    """The map as `usmap map` makes it, with poses corrected where they are not right as told.

    Or with `live_every` as nodes publish it at the last ping, before they explain all pings anew.
    """
    pipeline = Pipeline(parameters)
    for number, (topic, cone) in enumerate(PoseRun(parameters).corrected(cones), 1):
        pipeline.fuse(cone, topic)
        if live_every and number % live_every == 0:
            pipeline.fusion.live_snapshot()()
    return pipeline.fusion.live_snapshot()() if live_every else pipeline.occupancy_map()


def _max_merged(maps: list[OccupancyMap]) -> OccupancyMap:
    """The largest log-odds of each cell among the maps that observed it."""
    geometry = GridGeometry.around([single.geometry for single in maps])
    log_odds = np.full(geometry.shape, -np.inf, dtype=np.float32)
    for single in maps:
        window = log_odds[single.geometry.within(geometry)]
        seen = np.where(single.observed, single.log_odds, np.float32(-np.inf))
        np.maximum(window, seen, out=window)
    observed = np.isfinite(log_odds)
    # Nothing is known of the rest, which no score looks at.
    return OccupancyMap(geometry, np.where(observed, log_odds, 0.0), observed, maps[0].frame_id)
