"""What is wrong with a robot's poses by its own echoes: not what fits by chance."""

import math
from dataclasses import replace

import numpy as np
import pytest

import usmap_ros
from usmap_ros.mapping.robot_check import displacement
from usmap_ros.mapping.robot_check.displacement import Robot
from usmap_ros.mapping.robot_check.sightings import sightings_of
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.reconstruction.reconstructor import reconstruct

#: Pings of each of three sides of a square, and those of them that hear anything.
SIDE, HEARING = 30, range(8, 21)
STEP_S, STEP_M = 0.1, 0.1
#: What is heard from the first side, and from the second.
FIRST_M = np.array([[0.6, 1.2], [0.9, 1.7], [1.2, 1.1], [1.5, 1.6], [1.9, 1.2]])
SECOND_M = np.array([[1.9, 0.9], [1.4, 1.5], [1.7, 2.2]])


def around_a_square(apart_m: float) -> list[EchoCone]:
    """Give pings of one that hears from the third side what it did from the first, so far west."""
    heard_m = (FIRST_M, SECOND_M, FIRST_M - [apart_m, 0.0])
    pings = []
    for number in range(3 * SIDE):
        side, step = divmod(number, SIDE)
        on_m, far_m = STEP_M * step, STEP_M * SIDE
        pose = (
            Pose.planar(on_m, 0.0, 0.5 * math.pi),
            Pose.planar(far_m, on_m, math.pi),
            Pose.planar(far_m - on_m, far_m, -0.5 * math.pi),
        )[side]
        points_m = heard_m[side] if step in HEARING else np.zeros((0, 2))
        trace = usmap_ros.hear(points_m, pose=pose)
        cone = reconstruct(trace, ReconstructionParameters()).cone
        pings.append(replace(cone, stamp_ns=round(1e9 * STEP_S * number)))
    return pings


def test_a_delay_by_which_no_part_of_the_way_gains_is_no_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Poses that are 0.9 s late would make one row of poles of two that hide each other."""
    monkeypatch.setattr(displacement, "TURNS_RAD", (0.4, -1.6))
    cones = around_a_square(0.6)
    heard = sightings_of(cones)
    assert heard is not None
    assert Robot(cones, heard).displacement() is None
