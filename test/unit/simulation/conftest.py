"""What the simulation's tests share."""

from pathlib import Path

import numpy as np
import pytest

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import Encoding
from usmap_ros.simulation.receiver import Receiver
from usmap_ros.simulation.scene import Discs, Scene
from usmap_ros.simulation.simulator import MountedTransducer
from usmap_ros.simulation.surfaces import Surface, WallSegments, scatter_along

ROOT = Path(__file__).parents[3]
SMOOTH = Surface(specular_reflectivity=1.0, diffuse_reflectivity=0.0)
ROUGH = Surface(specular_reflectivity=0.0, diffuse_reflectivity=2.0)
HANN = Pulse(PulseShape.HANN_BURST, 50_000.0, 0.00032)


@pytest.fixture(scope="session")
def scenario_folder():
    return ROOT / "config" / "scenarios"


def make_points(*positions, reflectivity=1.0, radius=0.0):
    count = len(positions)
    centers = np.array(positions, dtype=float).reshape(-1, 2)
    return Discs(centers, np.full(count, radius), np.full(count, reflectivity))


def make_walls(*corners, surface=SMOOTH, one_sided=False):
    return WallSegments.along(np.array(corners, dtype=float), surface, one_sided=one_sided)


def make_scene(discs=None, walls=None, surface=SMOOTH, **others):
    walls = WallSegments.joined([]) if walls is None else walls
    scatterers = scatter_along(walls, surface, np.random.default_rng(0))
    return Scene(make_points() if discs is None else discs, walls, scatterers, **others)


def make_sonar(encoding=Encoding.IQ, *, rate=25_000.0, noise=0.0, pulse=HANN, **others):
    channel = others.pop("channel", Channel(343.0))
    receiver = Receiver(encoding, rate, 0.0, noise, others.pop("converter", None))
    settings = {
        "topic": "/robot1/echo",
        "child_frame_id": "robot1/sonar",
        "mount": Pose.planar(0.0, 0.0, 0.0),
        "transducer": Transducer(pulse, BeamPattern.linear(), 0.2, 5.0),
        "receiver": receiver,
        "channel": channel,
        "stated_channel": channel,
        "stated_noise_std": receiver.stated_noise_std,
        "pose_stds": np.zeros(3),
    }
    return MountedTransducer(**(settings | others))


@pytest.fixture(scope="session")
def points():
    """Make discs of one radius and one reflectivity."""
    return make_points


@pytest.fixture(scope="session")
def walls():
    """Make walls from corner to corner."""
    return make_walls


@pytest.fixture(scope="session")
def scene():
    """Make a scene of discs and walls."""
    return make_scene


@pytest.fixture(scope="session")
def sonar():
    """Make a transducer in the middle of a robot, in ideal air."""
    return make_sonar


@pytest.fixture(scope="session")
def rough():
    """A surface that only scatters."""
    return ROUGH
