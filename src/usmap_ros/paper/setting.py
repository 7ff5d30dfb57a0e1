"""The setting of the paper's experiments: sensor, grid, objects.

Sanchez & Andersson, "Using compressive sensing with in-air ultrasonic measurements for robotic
mapping", DSCC 2018-9140.  The cone of 80°, cells of 1 m, the sparsity of 15 and the height of
1 m are the paper's; where it leaves a choice open, ``docs/paper.md`` says what was chosen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from usmap_ros import simulation
from usmap_ros.acoustics.beam import BeamPattern
from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.acoustics.transducer import Transducer
from usmap_ros.numerics.arrays import FloatArray, IndexArray
from usmap_ros.numerics.geometry import Pose
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.trace import EchoTrace, Encoding
from usmap_ros.reconstruction.cells import CellReconstruction
from usmap_ros.simulation.receiver import Receiver

Points = Sequence[tuple[float, float]]

CELL_M = 1.0
SPARSITY = 15
MAX_RANGE_M = 10.0
AIR = Channel(343.0)
#: A hard floor 1 m under the transducer, and a soft one.
CONCRETE = Channel(343.0, floor_height_m=1.0, floor_reflectivity=0.9)
CARPET = replace(CONCRETE, floor_reflectivity=0.3)
#: In the middle of a cell's edge, looking along the grid's y axis: every cell off the axis has a
#: mirror image.
ALIGNED = Pose.planar(0.5, 0.0, np.deg2rad(90.0))
#: Turned against the grid, and not on one of its lines: no cell has a mirror.
OBLIQUE = Pose.planar(0.37, 0.13, np.deg2rad(79.0))
#: Cells of the near, the middle and the far object; the far one is on the axis.
CENTRES: Points = ((1.5, 2.5), (-0.5, 4.5), (0.5, 6.5))
MIRROR_IMAGES: Points = ((-0.5, 2.5), (1.5, 4.5))
#: Where the objects really are: not at the centres of the cells, but a centimetre beside them.
OBJECTS: Points = ((1.493, 2.507), (-0.507, 4.493), (0.507, 6.507))
NAMES = ("near", "middle", "far")

SQUARE = Pulse(PulseShape.SQUARE, 0.0, 1e-3)
#: Long enough for the paths over the floor to overlap, and interfere, with the direct one, and
#: of a wavelength (46 cm) beside which a centimetre is little.
SINE = Pulse(PulseShape.TONE_BURST, 750.0, 5e-3)
SMOOTH = Pulse(PulseShape.HANN_BURST, 50e3, 1e-3)
SHORT = Pulse(PulseShape.HANN_BURST, 50e3, 0.32e-3)


@dataclass(frozen=True)
class SampledPulse:
    """A pulse, and how its echoes are sampled."""

    pulse: Pulse
    encoding: Encoding
    #: Of samples, or of I/Q pairs.
    sample_rate_hz: float
    #: How far away objects are listened for.
    max_range_m: float = MAX_RANGE_M


#: The square pulse of the paper's first half, and the sinusoids of its section 4.
SQUARE_PULSE = SampledPulse(SQUARE, Encoding.RAW, 10e3)
SINUSOID = SampledPulse(SINE, Encoding.RAW, 10e3)
#: What the product listens to unless told otherwise.
BASEBAND = SampledPulse(SMOOTH, Encoding.IQ, 25e3)
SHORT_PULSE = SampledPulse(SHORT, Encoding.IQ, 25e3, max_range_m=5.0)


def method(**changes: object) -> ReconstructionParameters:
    """Parameters of the paper's method: CoSaMP on cells of 1 m, not negative, sparsity 15."""
    paper = {"dictionary": "cells", "cell_size_m": CELL_M, "sparsity": SPARSITY}
    return ReconstructionParameters.model_validate(paper | changes)


def hear(
    points: Points | FloatArray,
    listening: SampledPulse,
    *,
    reflectivities: Sequence[float] | FloatArray | None = None,
    channel: Channel = AIR,
    stated: Channel | None = None,
    noise_std: float = 0.0,
    pose: Pose = ALIGNED,
    seed: int = 0,
) -> EchoTrace:
    """`usmap_ros.simulation.hear` one ping, with the paper's transducer.

    Parameters
    ----------
    points : (n, 2) array-like
        Where objects stand.
    listening : SampledPulse
        Pulse and sampling.
    reflectivities : (n,) array-like, optional
        Of the objects; 1 by default.
    channel, stated : Channel
        What the sound travels through, and what the trace says it does.
    noise_std : float
        RMS of the receiver's complex noise.
    pose : Pose
        Of the transducer.
    seed : int
        Of the noise.
    """
    return simulation.hear(
        points,
        1.0 if reflectivities is None else reflectivities,
        pose=pose,
        transducer=Transducer(listening.pulse, BeamPattern.linear(), 0.3, listening.max_range_m),
        receiver=Receiver(listening.encoding, listening.sample_rate_hz, 0.0, noise_std),
        channel=channel,
        stated_channel=stated,
        seed=seed,
    )


def coefficients_by_cell(found: CellReconstruction, least: float = 1e-4) -> list[dict[str, float]]:
    """Cells with a coefficient, for ``paper.json``: centre and value, the largest first."""
    order = np.argsort(-found.coefficients, kind="stable")
    centers_m = found.dictionary.cells.centers_m
    return [
        {
            "x_m": float(centers_m[cell, 0]),
            "y_m": float(centers_m[cell, 1]),
            "coefficient": float(found.coefficients[cell]),
        }
        for cell in order
        if found.coefficients[cell] > least
    ]


#: A set of cells counts as found from half of an ideal object on.
FOUND_WEIGHT = 0.5


def found_sets(found: CellReconstruction) -> IndexArray:
    """Sets of cells with parallel columns whose coefficients amount to half an object."""
    weights = np.bincount(found.sets, found.coefficients)
    return np.flatnonzero(weights >= FOUND_WEIGHT)


def sets_of(found: CellReconstruction, points: Points | FloatArray) -> IndexArray:
    """Sets of the cells in which points lie."""
    cells = found.dictionary.cells
    places = np.floor(np.asarray(points, dtype=float) / cells.resolution_m).astype(int)
    match = (cells.columns == places[:, :1]) & (cells.rows == places[:, 1:])
    return np.unique(found.sets[np.flatnonzero(match.any(axis=0))])


def weights_at(found: CellReconstruction, points: Points | FloatArray) -> FloatArray:
    """Coefficients of each point's cell and its mirror images together, in units of an object."""
    weights = np.bincount(found.sets, found.coefficients)
    return np.array([weights[sets_of(found, [point])].sum() for point in points])


def spent(found: CellReconstruction) -> int:
    """Cells that have a coefficient."""
    return int(np.count_nonzero(found.coefficients))


def f1_of_sets(found: CellReconstruction, points: Points | FloatArray) -> float:
    """F1 of the sets that were found; mirror images, which no trace can exclude, are one set."""
    return f1(found_sets(found), sets_of(found, points))


def f1(predicted: IndexArray, truth: IndexArray) -> float:
    """Harmonic mean of precision and recall of two sets of numbers."""
    right = len(np.intersect1d(predicted, truth))
    return 2.0 * right / max(len(predicted) + len(truth), 1)
