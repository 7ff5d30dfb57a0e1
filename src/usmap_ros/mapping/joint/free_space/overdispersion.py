"""How far looks from one side repeat each other: a Gamma-Poisson model of silence.

Some surfaces answer one side less than others do, or not at all: they are smooth, or thin, or
hidden by something that nobody knows of.  Then they are silent again and again, and a hundred
silent looks from there do not say a hundred times what one says.  If the rate at which a surface
answers one side is that of all surfaces times a factor with a Gamma distribution of mean 1 and of
some shape k, all looks from there are silent with probability (1 + s / k)^-k, where s is what each
of them says by itself, added up.  The shape is learnt from surfaces that are believed.
"""

import math

import numpy as np

from usmap_ros.mapping.joint.free_space.response import SurfaceViews
from usmap_ros.mapping.joint.visibility.soundings import SECTORS
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Shapes that are compared, and the one that is expected where little has been heard: how many
#: times more or less it may be, as a standard deviation of its logarithm.
SHAPES = np.geomspace(0.7, 6.0, 25)
USUAL_SHAPE, USUAL_FACTOR = 2.5, 2.0
#: Surfaces on which less sound fell than would say so much say nothing of the shape.
LEAST_SAID = 0.5


def learn_shape(views: SurfaceViews, log_silent: FloatArray) -> float:
    """Shape of the distribution of how readily surfaces answer one side, by maximum a posteriori.

    Parameters
    ----------
    views : SurfaceViews
        Looks at surfaces that are believed.
    log_silent : (LOUDNESSES, INCIDENCES) array
        Logarithm of P(silent | surface).
    """
    side = views.surface.astype(np.int64) * SECTORS + views.sector
    said = np.bincount(side, -log_silent[views.loud, views.incidence]).astype(np.float64)
    heard = np.bincount(side, views.heard) > 0.0
    counts = said > LEAST_SAID
    return most_likely_shape(said[counts], heard[counts])


def most_likely_shape(said: FloatArray, heard: BoolArray) -> float:
    """Shape at which surfaces are silent as often as they were, by what looks said of each."""
    logs = -SHAPES * np.log1p(said[:, np.newaxis] / SHAPES)
    likelihood = np.where(heard[:, np.newaxis], np.log(-np.expm1(logs)), logs).sum(axis=0)
    unusual = np.log(SHAPES / USUAL_SHAPE) / math.log(USUAL_FACTOR)
    return float(SHAPES[np.argmax(likelihood - 0.5 * unusual**2)])
