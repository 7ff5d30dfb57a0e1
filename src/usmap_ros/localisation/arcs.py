"""Echoes and the field of what answers: compiled.

An echo says that something answers on an arc.  The field is the density of echoes by place; each
echo has a share of it everywhere on its arc, by how much others put there (expectation step), and
the shares are the field again (maximisation step; Dempster, Laird & Rubin 1977).  What stands
close to the arc pulls the pose along the ray to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.localisation.echo_table import Echoes
from usmap_ros.numerics.arrays import BoolArray, FloatArray
from usmap_ros.numerics.compiled import compiled, compiled_within

#: Samples along an arc, at least and at most.
LEAST_SAMPLES, MOST_SAMPLES = 9, 192
#: Across an arc the field counts so many standard deviations far.
_REACH = 2.5
#: Shares that are less do not pull.
_LEAST_SHARE = 0.01


class Field(NamedTuple):
    """What answers, by place.

    Parameters
    ----------
    density : (rows, columns) array
        Echoes per square metre.
    x_m, y_m : float
        Lower left corner.
    cell_m : float
        Side of a cell.
    sigma_m : float
        Standard deviation of its blur.
    background : float
        Echoes per metre of range that nothing known explains.
    """

    density: FloatArray
    x_m: float
    y_m: float
    cell_m: float
    sigma_m: float
    background: float


class Pulls(NamedTuple):
    """What draws echoes to places: one row for each sample of an arc that counts.

    Parameters
    ----------
    echo : (n,) int array
        Which echo.
    cell : (n,) int array
        Where: a number that those of one place share.
    weight : (n,) array
        Its share of the echo.
    x_m, y_m : (n,) arrays
        Where the pose has it.
    """

    echo: NDArray[np.int64]
    cell: NDArray[np.int64]
    weight: FloatArray
    x_m: FloatArray
    y_m: FloatArray


@compiled_within
def count_samples(range_m: float, half_angle_rad: float, cell_m: float) -> int:
    """Samples of an arc, about a cell apart."""
    return min(MOST_SAMPLES, max(LEAST_SAMPLES, int(2.0 * half_angle_rad * range_m / cell_m)))


@compiled_within
def gain_at(echoes: Echoes, echo: int, angle_rad: float) -> float:
    """How likely an echo comes from so far off the axis."""
    gain = 1.0 - abs(angle_rad) / echoes.half_angle_rad[echo]
    off = (angle_rad - echoes.bearing_rad[echo]) / echoes.bearing_std_rad[echo]
    return float(gain * math.exp(-0.5 * off * off) + 1e-3)


@compiled_within
def own_density(
    own: FloatArray, count: int, step_m: float, sigma_m: float, out: FloatArray
) -> None:
    """What an echo's own shares add to the field along its arc."""
    reach = int(3.0 * sigma_m / step_m) + 1
    for k in range(count):
        total = 0.0
        for q in range(max(0, k - reach), min(count, k + reach + 1)):
            off = (q - k) * step_m / sigma_m
            total += own[q] * math.exp(-0.5 * off * off)
        out[k] = total / (2.0 * math.pi * sigma_m * sigma_m)


@compiled_within
def field_at(field: Field, x_m: float, y_m: float) -> float:
    """The field between the centres of its cells; 0 outside."""
    density = field.density
    column = (x_m - field.x_m) / field.cell_m - 0.5
    row = (y_m - field.y_m) / field.cell_m - 0.5
    left, low = math.floor(column), math.floor(row)
    if left < 0 or low < 0 or left >= density.shape[1] - 1 or low >= density.shape[0] - 1:
        return 0.0
    right_share, up_share = column - left, row - low
    lower = density[low, left] * (1.0 - right_share) + density[low, left + 1] * right_share
    upper = density[low + 1, left] * (1.0 - right_share) + density[low + 1, left + 1] * right_share
    return float(lower * (1.0 - up_share) + upper * up_share)


@compiled_within
def weigh_arc(
    field: Field,
    pose: FloatArray,
    echoes: Echoes,
    echo: int,
    own: FloatArray,
    sums: FloatArray,
    offsets_m: FloatArray,
) -> float:
    """How much of the field there is at each sample of an arc, and how far behind it on average.

    Returns
    -------
    float
        All of it together, per metre of range.
    """
    range_m, half = echoes.range_m[echo], echoes.half_angle_rad[echo]
    sigma_m = field.sigma_m
    count = count_samples(range_m, half, field.cell_m)
    step_rad = 2.0 * half / count
    reach = math.ceil(_REACH * sigma_m / field.cell_m)
    scale = field.cell_m / (math.sqrt(2.0 * math.pi) * sigma_m) * step_rad * range_m
    total = 0.0
    for k in range(count):
        angle = (k + 0.5) * step_rad - half
        along_x, along_y = math.cos(pose[2] + angle), math.sin(pose[2] + angle)
        found, moment = 0.0, 0.0
        for q in range(-reach, reach + 1):
            off_m = q * field.cell_m
            near = math.exp(-0.5 * (off_m / sigma_m) ** 2)
            x_m = pose[0] + (range_m + off_m) * along_x
            y_m = pose[1] + (range_m + off_m) * along_y
            density = field_at(field, x_m, y_m) - own[k] * near
            if density > 0.0:
                found += density * near
                moment += density * near * off_m
        sums[k] = found * gain_at(echoes, echo, angle) * scale
        offsets_m[k] = moment / found if found > 0.0 else 0.0
        total += sums[k]
    return total


@compiled
def expect(
    field: Field,
    poses: FloatArray,
    active: BoolArray,
    echoes: Echoes,
    coarse: int,
    shares: NDArray[np.float32],
    pulls: Pulls,
) -> tuple[int, float]:
    """Share each echo out along its arc by what all others say.

    Parameters
    ----------
    field : Field
        What answers.
    poses : (pings, 3) array
        x, y (m) and yaw (rad).
    active : (pings,) bool array
        Whose echoes count.
    echoes : Echoes
        All echoes.
    coarse : int
        Cells along the side of a place.
    shares : (echoes, samples) array
        Of each echo before; replaced.
    pulls : Pulls
        Room for what draws them; filled.

    Returns
    -------
    pulls : int
        How many there are.
    log_likelihood : float
        Of all echoes, relative to background alone.
    """
    own, sums = np.zeros(MOST_SAMPLES), np.zeros(MOST_SAMPLES)
    offsets_m, pulled, likelihood = np.zeros(MOST_SAMPLES), 0, 0.0
    columns = field.density.shape[1] // coarse + 1
    for echo in range(len(echoes.ping)):
        ping = echoes.ping[echo]
        if not active[ping]:
            continue
        pose, range_m, half = poses[ping], echoes.range_m[echo], echoes.half_angle_rad[echo]
        count = count_samples(range_m, half, field.cell_m)
        step_rad, weight = 2.0 * half / count, echoes.weight[echo]
        own_density(shares[echo], count, step_rad * range_m, field.sigma_m, own)
        for k in range(count):
            own[k] *= weight
        total = weigh_arc(field, pose, echoes, echo, own, sums, offsets_m)
        evidence = total + field.background
        likelihood += weight * math.log(evidence / field.background)
        gains = 0.0
        for k in range(count):
            gains += gain_at(echoes, echo, (k + 0.5) * step_rad - half)
        for k in range(count):
            angle = (k + 0.5) * step_rad - half
            rest = field.background * gain_at(echoes, echo, angle) / gains
            shares[echo, k] = (sums[k] + rest) / evidence
            share = sums[k] / evidence
            if share < _LEAST_SHARE or pulled >= len(pulls.echo):
                continue
            along_x, along_y = math.cos(pose[2] + angle), math.sin(pose[2] + angle)
            far_m = range_m + offsets_m[k]
            column = int((pose[0] + far_m * along_x - field.x_m) / field.cell_m) // coarse
            row = int((pose[1] + far_m * along_y - field.y_m) / field.cell_m) // coarse
            pulls.echo[pulled], pulls.cell[pulled] = echo, row * columns + column
            pulls.weight[pulled] = share * weight
            pulls.x_m[pulled] = pose[0] + range_m * along_x
            pulls.y_m[pulled] = pose[1] + range_m * along_y
            pulled += 1
    return pulled, likelihood


@compiled
def deposit(
    field: Field,
    poses: FloatArray,
    wanted: BoolArray,
    echoes: Echoes,
    shares: NDArray[np.float32],
    out: FloatArray,
) -> None:
    """Add the shares of wanted pings' echoes to the cells around their places."""
    for echo in range(len(echoes.ping)):
        ping = echoes.ping[echo]
        if not wanted[ping]:
            continue
        range_m, half = echoes.range_m[echo], echoes.half_angle_rad[echo]
        count = count_samples(range_m, half, field.cell_m)
        for k in range(count):
            share = shares[echo, k] * echoes.weight[echo]
            if share < 1e-5:
                continue
            direction = poses[ping, 2] + (k + 0.5) * 2.0 * half / count - half
            x_m = poses[ping, 0] + range_m * math.cos(direction)
            y_m = poses[ping, 1] + range_m * math.sin(direction)
            column = (x_m - field.x_m) / field.cell_m - 0.5
            row = (y_m - field.y_m) / field.cell_m - 0.5
            left, low = math.floor(column), math.floor(row)
            if left < 0 or low < 0 or left >= out.shape[1] - 1 or low >= out.shape[0] - 1:
                continue
            right_share, up_share = column - left, row - low
            out[low, left] += share * (1.0 - right_share) * (1.0 - up_share)
            out[low, left + 1] += share * right_share * (1.0 - up_share)
            out[low + 1, left] += share * (1.0 - right_share) * up_share
            out[low + 1, left + 1] += share * right_share * up_share


@compiled
def pull_poses(
    field: Field,
    poses: FloatArray,
    wanted: BoolArray,
    echoes: Echoes,
    information: FloatArray,
    gradient: FloatArray,
) -> None:
    """Add to each wanted ping how its place is drawn towards a field that it has no part in.

    Parameters
    ----------
    field, poses, echoes
        As of `expect`.
    wanted : (pings,) bool array
        Whose poses.
    information : (pings, 2, 2) array
        Of x and y, per m².
    gradient : (pings, 2) array
        Of the log-likelihood, per m.
    """
    nothing, sums = np.zeros(MOST_SAMPLES), np.zeros(MOST_SAMPLES)
    offsets_m = np.zeros(MOST_SAMPLES)
    for echo in range(len(echoes.ping)):
        ping = echoes.ping[echo]
        if not wanted[ping]:
            continue
        pose, half = poses[ping], echoes.half_angle_rad[echo]
        count = count_samples(echoes.range_m[echo], half, field.cell_m)
        total = weigh_arc(field, pose, echoes, echo, nothing, sums, offsets_m)
        scale = echoes.weight[echo] / ((total + field.background) * field.sigma_m**2)
        for k in range(count):
            direction = pose[2] + (k + 0.5) * 2.0 * half / count - half
            along_x, along_y = math.cos(direction), math.sin(direction)
            pulled = sums[k] * scale
            information[ping, 0, 0] += pulled * along_x * along_x
            information[ping, 0, 1] += pulled * along_x * along_y
            information[ping, 1, 0] += pulled * along_x * along_y
            information[ping, 1, 1] += pulled * along_y * along_y
            gradient[ping, 0] += pulled * along_x * offsets_m[k]
            gradient[ping, 1] += pulled * along_y * offsets_m[k]
