"""The cells of a grid that one sensing cone covers, in polar coordinates of the transducer."""

from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import IndexArray, RealArray
from usmap_ros.numerics.geometry import at_height, wrapped
from usmap_ros.pings.cone import EchoCone

#: Gain at which the beam counts as silent: keeps logarithms finite.
LEAST_GAIN = 1e-6


@dataclass(frozen=True)
class Footprint:
    """Cells inside a cone, each array of shape (cells,)."""

    #: Of the cells.
    rows: IndexArray
    columns: IndexArray
    #: From the transducer to the cell's centre.
    range_m: RealArray
    #: Of the centre off the beam axis.
    bearing_rad: RealArray
    #: How far from the centre, along the ray, an object in the cell can stand.
    half_depth_m: RealArray
    #: Length over which, at either end of that depth, the likelihood of a range falls off: a square
    #: seen along its side has none, one seen across a corner tapers all the way.
    taper_m: RealArray
    #: Standard deviation of the range that the pose's covariance causes.
    range_std_m: RealArray
    #: ln of the amplitude of the direct echo of an object of reflectivity 1 in the cell.
    log_unit_amplitude: RealArray


def footprint(cone: EchoCone, resolution_m: float, farthest_m: float = np.inf) -> Footprint:
    """Cells whose centres lie in the beam of `cone`, between its least and greatest range.

    Only cells in the box around the cone are looked at: the cost follows the cone, not the map.

    Parameters
    ----------
    cone : EchoCone
        Of which ping.
    resolution_m : float
        Side of a cell.
    farthest_m : float
        Range beyond which cells are of no interest, though they may be in the cone.

    Returns
    -------
    cells : Footprint
        Row by row.
    """
    beam, reach_m = cone.transducer.beam, min(cone.transducer.max_range_m, farthest_m)
    x_m, y_m = cone.pose.position_m[:2]
    yaw_rad = cone.pose.yaw_rad
    columns, rows = _cells_in_box(cone, resolution_m, reach_m)
    height_m = cone.pose.position_m[2] + cone.object_rise_m
    east_m = (columns + 0.5) * resolution_m - x_m
    north_m = (rows + 0.5) * resolution_m - y_m
    range_m = np.sqrt(east_m[np.newaxis, :] ** 2 + north_m[:, np.newaxis] ** 2)
    ahead_m = np.cos(yaw_rad) * east_m[np.newaxis, :] + np.sin(yaw_rad) * north_m[:, np.newaxis]
    if cone.pose.is_tilted or cone.object_rise_m:
        # In the plane alone neither range nor angle is what it is in space.
        every_m = np.stack(np.meshgrid(east_m + x_m, north_m + y_m), axis=-1).reshape(-1, 2)
        range_m, off_axis = (
            values.reshape(range_m.shape)
            for values in cone.pose.polar(at_height(every_m, height_m))
        )
        in_beam = np.abs(off_axis) < beam.half_angle_rad
    else:
        in_beam = ahead_m > range_m * np.cos(min(beam.half_angle_rad, np.pi))
    in_range = (range_m > cone.transducer.min_range_m) & (range_m < reach_m)
    row, column = np.nonzero(in_beam & in_range)
    centers_m = np.stack([columns[column] + 0.5, rows[row] + 0.5], axis=-1) * resolution_m
    range_m, bearing_rad = cone.pose.polar(
        at_height(centers_m, height_m) if cone.object_rise_m else centers_m
    )
    cosine, sine = east_m[column] / range_m, north_m[row] / range_m
    range_std_m = _range_spread(cone.pose.planar_covariance, cosine, sine)
    gain = np.maximum(beam.gain(bearing_rad), LEAST_GAIN)
    absorption = cone.attenuation_db_m * np.log(10.0) / 20.0
    log_unit_amplitude = np.log(gain) - 2.0 * (np.log(range_m) + absorption * range_m)
    return Footprint(
        rows=rows[row],
        columns=columns[column],
        range_m=range_m,
        bearing_rad=bearing_rad,
        half_depth_m=0.5 * resolution_m * (np.abs(cosine) + np.abs(sine)),
        taper_m=resolution_m * np.minimum(np.abs(cosine), np.abs(sine)),
        range_std_m=range_std_m,
        log_unit_amplitude=log_unit_amplitude,
    )


def _cells_in_box(
    cone: EchoCone, resolution_m: float, reach_m: float
) -> tuple[IndexArray, IndexArray]:
    """Columns and rows of the box around the sector that the beam covers up to some range."""
    x_m, y_m = cone.pose.position_m[:2]
    half_angle = cone.transducer.beam.half_angle_rad
    if cone.pose.is_tilted or cone.object_rise_m:
        half_angle = np.pi
    # The extremes of a sector lie at its edges or where it crosses an axis.
    quarters = np.arange(-2.0, 3.0) * (np.pi / 2.0)
    crossing = wrapped(quarters - cone.pose.yaw_rad)
    offsets = np.concatenate([[-half_angle, half_angle], crossing[np.abs(crossing) <= half_angle]])
    angles = cone.pose.yaw_rad + offsets
    xs = x_m + reach_m * np.append(np.cos(angles), 0.0)
    ys = y_m + reach_m * np.append(np.sin(angles), 0.0)
    columns = np.arange(np.floor(xs.min() / resolution_m), np.ceil(xs.max() / resolution_m))
    rows = np.arange(np.floor(ys.min() / resolution_m), np.ceil(ys.max() / resolution_m))
    return columns.astype(np.intp), rows.astype(np.intp)


def _range_spread(covariance: RealArray, cosine: RealArray, sine: RealArray) -> RealArray:
    """Standard deviation of the range of fixed points, to first order in the pose."""
    (xx, xy, _), (_, yy, _), _ = covariance
    along = cosine**2 * xx + 2.0 * cosine * sine * xy + sine**2 * yy
    spread: RealArray = np.sqrt(np.maximum(along, 0.0))
    return spread
