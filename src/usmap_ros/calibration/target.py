"""An object that a calibration may rely on."""

from dataclasses import dataclass

#: Widest range offset with which it is looked for.
WIDEST_OFFSET_M = 0.3


@dataclass(frozen=True)
class Target:
    """An object of which is known where it stands."""

    #: Position of its centre in the world frame.
    x_m: float
    y_m: float
    #: As a point target; None: not known.
    reflectivity: float | None = None
    #: Distance of its surface from there.
    radius_m: float = 0.0
