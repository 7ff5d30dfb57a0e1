"""Where robots are, from their own echoes, when their odometry drifts.

`pose_kind` says what reported poses are worth, `refine` corrects those that drift, `map_match`
finds how the frames of two robots relate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from usmap_ros.lazy_names import offered

if TYPE_CHECKING:
    from usmap_ros.localisation.map_match import Match, match_maps
    from usmap_ros.localisation.pose_kind import PoseKind, pose_kind
    from usmap_ros.localisation.refine import Refinement, refine_poses

__all__ = ["Match", "PoseKind", "Refinement", "match_maps", "pose_kind", "refine_poses"]

__getattr__ = offered(
    __name__,
    {
        "map_match": ["Match", "match_maps"],
        "pose_kind": ["PoseKind", "pose_kind"],
        "refine": ["Refinement", "refine_poses"],
    },
)
