"""A trace and a cone that could be true; `dataclasses.replace` makes them others."""

import numpy as np

from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.geometry import Pose
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace, Encoding

PULSE = Pulse(PulseShape.HANN_BURST, 50e3, 0.32e-3)
TRANSDUCER = Transducer(
    PULSE, BeamPattern(np.array([0.0, 0.35, 0.7]), np.array([1.0, 0.5, 0.0])), 0.2, 5.0
)
TRACE = EchoTrace(
    stamp_ns=1,
    frame_id="map",
    child_frame_id="robot1/sonar",
    pose=Pose.planar(1.0, 2.0, 0.5, planar_covariance=np.diag([1e-4, 1e-4, 1e-5])),
    transducer=TRANSDUCER,
    channel=Channel(343.0, 1.3, 0.5, 0.25),
    encoding=Encoding.IQ,
    sample_rate_hz=25e3,
    start_delay_s=0.001,
    noise_std=0.01,
    samples=np.array([1, 2, 3, 4], dtype=np.float32),
)
CONE = EchoCone(
    stamp_ns=1,
    frame_id="map",
    child_frame_id="robot1/sonar",
    pose=Pose.planar(1.0, 2.0, 0.5),
    transducer=TRANSDUCER,
    attenuation_db_m=1.3,
    ranges_m=np.array([1.0, 2.0], dtype=np.float32),
    range_stds_m=np.array([0.001, 0.002], dtype=np.float32),
    amplitudes=np.array([0.5, 0.1], dtype=np.float32),
    amplitude_stds=np.array([0.01, 0.01], dtype=np.float32),
    limit_step_m=0.03125,
    detection_limits=np.arange(192, dtype=np.uint8),
    residual=0.25,
)
