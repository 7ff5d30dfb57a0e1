"""One ping at points: the shortest way to a trace."""

import numpy as np
from numpy.typing import ArrayLike

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.trace import EchoTrace, Encoding
from usmap_ros.simulation.receiver import Receiver
from usmap_ros.simulation.scene import Discs, Scene
from usmap_ros.simulation.simulator import EchoSimulator, MountedTransducer
from usmap_ros.simulation.surfaces import WallScatterers, WallSegments

#: A burst of 50 kHz, the beam of the paper, and I/Q pairs at 25 kHz, through ideal air.
TRANSDUCER = Transducer(
    Pulse(PulseShape.HANN_BURST, 50_000.0, 0.00032), BeamPattern.linear(), 0.2, 5.0
)
RECEIVER = Receiver(Encoding.IQ, 25_000.0, 0.0, 0.0)
AIR = Channel(343.0)


def hear(
    points_m: ArrayLike,
    reflectivities: ArrayLike = 1.0,
    *,
    pose: Pose | None = None,
    transducer: Transducer = TRANSDUCER,
    receiver: Receiver = RECEIVER,
    channel: Channel = AIR,
    stated_channel: Channel | None = None,
    seed: int | np.random.Generator = 0,
) -> EchoTrace:
    """Simulate one ping at points, none of which hides another.

    Parameters
    ----------
    points_m : (n, 2) array-like
        x and y of what echoes, in the world frame.
    reflectivities : (n,) array-like or float
        Of the points.
    pose : Pose, optional
        Of the transducer; without one it is at the origin and looks along x.
    transducer : Transducer
        Pulse, beam and ranges of what pings.
    receiver : Receiver
        Encoding, rate, and the noise it adds.
    channel : Channel
        What the sound travels through.
    stated_channel : Channel, optional
        What the trace says it travels through, if that is not the truth.
    seed : int or numpy.random.Generator
        Of the noise.

    Examples
    --------
    >>> trace = hear([(1.0, 0.0), (3.0, 0.5)])
    >>> len(trace.signal())
    745
    """
    centers_m = np.asarray(points_m, dtype=float).reshape(-1, 2)
    strengths = np.broadcast_to(np.asarray(reflectivities, dtype=float), len(centers_m))
    discs = Discs(centers_m, np.zeros(len(centers_m)), strengths)
    at_origin = Pose.planar(0.0, 0.0, 0.0)
    sonar = MountedTransducer(
        topic="echo",
        child_frame_id="sonar",
        mount=at_origin,
        transducer=transducer,
        receiver=receiver,
        channel=channel,
        stated_channel=stated_channel or channel,
        stated_noise_std=receiver.stated_noise_std,
        pose_stds=np.zeros(3),
    )
    simulator = EchoSimulator(Scene(discs, WallSegments.joined([]), WallScatterers.joined([])))
    return simulator.ping(sonar, pose or at_origin, 0, np.random.default_rng(seed))
