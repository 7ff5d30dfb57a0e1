"""Parameters of where robots are."""

import math
from typing import Literal

from pydantic import field_validator

from usmap_ros.parameters.fields import ParameterGroup, quantity


class PoseParameters(ParameterGroup):
    """Which poses pings are mapped with."""

    use: Literal["auto", "told", "refined"] = quantity(
        "auto",
        "Poses as they were told; or refined by the echoes, absolute ones as well; or, by default,"
        " absolute ones as told, or each corrected by itself where a steady covariance says that"
        " they are off by 1 to 10 cm, and odometry refined: what is in a robot's own frame, and"
        " what has a covariance that grows along the way.",
    )
    initial_poses: list[str] = quantity(
        [""],
        "Where the frames of robots' odometry lie in the map's frame, as far as it is known, each"
        " as 'ROBOT X Y YAW' in m and rad; other robots' are found by what they hear.",
    )

    @field_validator("initial_poses")
    @classmethod
    def _can_be_read(cls, entries: list[str]) -> list[str]:
        for entry in filter(None, entries):
            if not _is_start(entry.split()):
                raise ValueError(f"'{entry}' is not of the form 'ROBOT X Y YAW'")
        robots = [entry.split()[0] for entry in entries if entry]
        if len(set(robots)) < len(robots):
            raise ValueError("a robot is there twice")
        return entries

    def starts(self) -> dict[str, tuple[float, float, float]]:
        """Poses x, y (m) and yaw (rad) of the frames of odometry, by robot."""
        found = {}
        for entry in filter(None, self.initial_poses):
            robot, x_m, y_m, yaw_rad = entry.split()
            found[robot.strip("/")] = float(x_m), float(y_m), float(yaw_rad)
        return found


def _is_start(words: list[str]) -> bool:
    """Whether words are a robot's name and three numbers."""
    try:
        return len(words) == 4 and all(math.isfinite(float(word)) for word in words[1:])
    except ValueError:
        return False
