"""The first pings: every cell weighed that may have returned an echo, without picking any.

Powers that explain what was heard are many while pings are few, and where the search for them ends
depends on where it starts.  So the odds of cells come from a simpler model then, in which each
quarter of a cell holds an object or none.  An echo has one source: its likelihood is a noisy-OR of
all quarters on its ring, each with the density of the echo's power if it came from there, given
what the other pings heard of it.  Belief propagation between echoes and quarters gives the odds.

References
----------
.. [1] Pearl, "Probabilistic Reasoning in Intelligent Systems" (1988), section 4.3: noisy-OR.
.. [2] Thrun, "Learning occupancy grid maps with forward sensor models", Autonomous Robots 15
   (2003) 111-127: explaining readings together, rather than cell by cell.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.log_odds import NOTHING, OWN_SHARE, over_block
from usmap_ros.mapping.joint.kept_pings import STEP_M, STEP_RAD
from usmap_ros.mapping.joint.visibility.field import QUARTERS, Field
from usmap_ros.mapping.joint.visibility.projection import MOST_BLUR_BINS
from usmap_ros.mapping.ping_bins import ECHO, GAIN_STEPS, SILENCE, UNJUDGED, PingBins
from usmap_ros.numerics.arrays import BoolArray, FloatArray, IndexArray
from usmap_ros.numerics.geometry import wrapped
from usmap_ros.numerics.special import logistic, logit
from usmap_ros.parameters import MappingParameters

#: From so few places, pings are explained in this way; those from one place are one look.
FEW_PLACES = 6
#: Quarters, times pings, that are compared at the most.
MOST_PAIRS = 200_000
#: Silence against a cell outweighs an echo for it when it is so many times as frequent.
SILENCE_COUNTS = 0.4
#: Density, per unit of the logarithm of power, of echoes that come from nowhere.
CLUTTER_DENSITY = 3e-3
#: Rounds of belief propagation, and the share of its last message that each keeps.
ROUNDS, DAMPING = 15, 0.3
#: Powers that an object may have, and how many standard deviations about the median they span.
POWER_STEPS, POWER_SPREAD = 80, 3.2
#: Bounds of likelihoods: of an echo's power, and of silence.
LEAST_LOG_DENSITY, LEAST_SILENCE = -12.0, 0.0025


class PlaceReadings(NamedTuple):
    """What each ping has of places that may have returned an echo; (pings, places) arrays."""

    #: ECHO, SILENCE or UNJUDGED.
    kind: NDArray[np.uint8]
    #: Range bin of the echo, or of the middle of the place.
    bin: IndexArray
    #: Power of the echo, or below which one may have gone unreported.
    level: FloatArray
    #: Of the logarithm of the echo's power.
    variance: FloatArray
    #: Power that would return if the place scattered with power 1.
    weight: FloatArray
    #: How well it fits a measured bearing.
    fit: FloatArray

    @classmethod
    def of_nothing(cls, places: int) -> PlaceReadings:
        """A row of places of which nothing is heard."""
        kind, echo_bin = np.full(places, UNJUDGED, np.uint8), np.zeros(places, np.int64)
        return cls(kind, echo_bin, *np.ones((4, places)))

    def of(self, places: IndexArray) -> PlaceReadings:
        """The same of some places."""
        parts: list[NDArray[Any]] = [values[:, places] for values in self]
        return PlaceReadings(*parts)


def first_log_odds(
    pings: Iterable[PingBins], field: Field, parameters: MappingParameters
) -> FloatArray | None:
    """Log-odds of the cells that may have returned any echo of a few pings.

    Parameters
    ----------
    pings : iterable of PingBins
        The pings, in bins of range; of those from one place only the last is looked at.
    field : Field
        The cells.
    parameters : MappingParameters
        What is known of objects beforehand.

    Returns
    -------
    log_odds : (rows, columns) array or None
        `NOTHING` where nothing is suspected; None if pings, or cells to suspect, are too many.
    """
    last: dict[tuple[int, int, int], PingBins] = {}
    for ping in pings:
        last[_place(ping)] = ping
        if len(last) > FEW_PLACES:
            return None
    few = list(last.values())
    suspected = np.flatnonzero(_suspects(few, field, parameters))
    if len(suspected) * QUARTERS * len(few) > MOST_PAIRS:
        return None
    x_m, y_m = _quarters(suspected, field)
    heard = read_places(few, x_m, y_m, 0.5 * field.resolution_m, parameters.fluctuation)
    density, prior = densities(heard, parameters), logit(parameters.prior / QUARTERS)
    odds = weigh_sources(heard, density, parameters.detection_probability, prior)
    vacancy = np.zeros(field.shape)
    vacancy.ravel()[suspected] = -np.logaddexp(0.0, odds).reshape(-1, QUARTERS).sum(axis=1)
    # What is certain of a block of nine counts for the cells that hold a fair share of it.
    is_minor = np.expm1(vacancy) > OWN_SHARE * np.expm1(over_block(vacancy, np.minimum))
    block = np.where(is_minor, vacancy, over_block(vacancy, np.add))
    log_odds = np.log(np.maximum(-np.expm1(block), 1e-30)) - block
    is_acquitted = (vacancy == 0.0) | (log_odds <= logit(parameters.prior))
    return np.where(is_acquitted, NOTHING, log_odds)


def _place(ping: PingBins) -> tuple[int, int, int]:
    """Where a ping looks from, in steps."""
    return (
        round(ping.x_m / STEP_M), round(ping.y_m / STEP_M), round(ping.heading_rad / STEP_RAD)
    )  # fmt: skip


def _suspects(pings: list[PingBins], field: Field, parameters: MappingParameters) -> BoolArray:
    """Cells for which more echoes speak than silence speaks against."""
    row, column = np.divmod(np.arange(field.rows * field.columns), field.columns)
    x_m = (field.first_column + column + 0.5) * field.resolution_m
    y_m = (field.first_row + row + 0.5) * field.resolution_m
    heard = read_places(pings, x_m, y_m, field.resolution_m, parameters.fluctuation)
    is_loud = heard.weight * parameters.reflectivity**2 > heard.level
    against = (heard.kind == SILENCE) & is_loud
    votes = np.sum((heard.kind == ECHO) - SILENCE_COUNTS * against, axis=0)
    suspected: BoolArray = votes > 0.0
    return suspected


def _quarters(cells: IndexArray, field: Field) -> tuple[FloatArray, FloatArray]:
    """Centres of the quarters of some cells, m, those of a cell one behind the other."""
    row, column = np.divmod(np.repeat(cells, QUARTERS), field.columns)
    part = np.tile(np.arange(QUARTERS), len(cells))
    right, up = np.where(part & 1, 0.75, 0.25), np.where(part & 2, 0.75, 0.25)
    x_m = (field.first_column + column + right) * field.resolution_m
    y_m = (field.first_row + row + up) * field.resolution_m
    return x_m, y_m


def read_places(
    pings: list[PingBins], x_m: FloatArray, y_m: FloatArray, side_m: float, fluctuation: float
) -> PlaceReadings:
    """What some pings have of square places.

    Parameters
    ----------
    pings : list of PingBins
        The pings.
    x_m, y_m : (places,) arrays
        Centres of the places.
    side_m : float
        Length of their sides.
    fluctuation : float
        Standard deviation of ln amplitude from look to look.
    """
    each = [_heard_by(ping, x_m, y_m, side_m, fluctuation) for ping in pings]
    rows: list[NDArray[Any]] = [np.array(values) for values in zip(*each, strict=True)]
    return PlaceReadings(*rows)


def _heard_by(
    ping: PingBins, x_m: FloatArray, y_m: FloatArray, side_m: float, fluctuation: float
) -> PlaceReadings:
    """What one ping has of places: a row of each field of `PlaceReadings`."""
    x, y = x_m - ping.x_m, y_m - ping.y_m
    distance = np.sqrt(x * x + y * y + ping.rise_m**2)
    cosine = (ping.axis_x * x + ping.axis_y * y + ping.axis_z * ping.rise_m) / distance
    inside = np.flatnonzero(
        (distance > ping.least_range_m)
        & (distance < ping.greatest_range_m)
        & (cosine > ping.cos_half_angle)
    )
    x, y, distance, cosine = x[inside], y[inside], distance[inside], cosine[inside]
    entry = (1.0 - cosine) / (1.0 - ping.cos_half_angle) * GAIN_STEPS
    gain = np.interp(entry, np.arange(GAIN_STEPS + 1), ping.power_gain)
    weight = np.maximum(gain * np.exp(-ping.absorption_per_m * distance) / distance**4, 1e-12)
    middle = (distance - ping.least_range_m) / ping.bin_m
    half_bins = 0.5 * side_m / ping.bin_m * (np.abs(x) + np.abs(y)) / distance
    spread = np.sqrt(half_bins**2 + 3.0 * (ping.range_std_m / ping.bin_m) ** 2)
    spread = np.maximum(np.minimum(spread, MOST_BLUR_BINS), half_bins)
    echo = _nearest_echo(ping, middle - spread, middle + spread)
    is_heard = echo >= 0
    at = np.where(is_heard, echo, np.clip(middle, 0, len(ping.kind) - 1).astype(np.int64))
    power = np.maximum(ping.power[at], ping.noise).astype(np.float64)
    level = np.where(is_heard, np.maximum(power - ping.noise, 0.25 * power), ping.limit[at])
    variance = 4.0 * fluctuation**2 + 2.0 * ping.noise / power
    off = wrapped(np.arctan2(y, x) - ping.heading_rad) - ping.bearing[at]
    readings = PlaceReadings.of_nothing(len(x_m))
    readings.kind[inside] = ping.kind[at]
    readings.bin[inside] = at
    readings.level[inside] = level
    readings.variance[inside] = variance
    readings.weight[inside] = weight
    readings.fit[inside] = np.where(is_heard, np.exp(-ping.bearing_weight[at] * off**2), 1.0)
    return readings


def _nearest_echo(ping: PingBins, low: FloatArray, high: FloatArray) -> IndexArray:
    """Range bin of the echo nearest to the middle of each stretch of bins; -1 if there is none."""
    echoes = np.flatnonzero(ping.kind == ECHO)
    if not len(echoes):
        return np.full(len(low), -1)
    middle = 0.5 * (low + high)
    after = np.searchsorted(echoes + 0.5, middle)
    before, after = np.maximum(after - 1, 0), np.minimum(after, len(echoes) - 1)
    is_before = middle - (echoes[before] + 0.5) < echoes[after] + 0.5 - middle
    nearest = echoes[np.where(is_before, before, after)]
    is_within = (nearest >= np.floor(low)) & (nearest <= np.floor(high))
    return np.where(is_within, nearest, -1)


def densities(heard: PlaceReadings, parameters: MappingParameters) -> FloatArray:
    """Density of what each ping has of each place, given what the other pings have of it.

    That is averaged over the powers that an object may have, lognormal about the median.

    Parameters
    ----------
    heard : PlaceReadings
        What the pings have of the places.
    parameters : MappingParameters
        What is known of objects beforehand.

    Returns
    -------
    density : (pings, places) array
        Of an echo's power if it came from there, or probability of silence.
    """
    off = np.linspace(-POWER_SPREAD, POWER_SPREAD, POWER_STEPS)
    spread = 2.0 * parameters.reflectivity_spread
    log_power = 2.0 * np.log(parameters.reflectivity) + spread * off
    density = np.ones(heard.kind.shape)
    # One place is one column: in batches, for each has a table of pings and powers.
    for batch in np.array_split(np.arange(heard.kind.shape[1]), 1 + heard.kind.size // 20_000):
        here = heard.of(batch)
        likely = _log_likelihood(here, log_power)
        total = (-0.5 * off**2)[:, np.newaxis] + likely.sum(axis=0)
        for index, of_ping in enumerate(likely):
            judged = np.flatnonzero(here.kind[index] != UNJUDGED)
            log_density = of_ping[:, judged]
            others = total[:, judged] - log_density
            others = np.exp(others - others.max(axis=0))
            mean = (others * np.exp(log_density)).sum(axis=0) / others.sum(axis=0)
            density[index, batch[judged]] = mean * here.fit[index, judged]
    return density


def _log_likelihood(heard: PlaceReadings, log_power: FloatArray) -> FloatArray:
    """Logarithm of the likelihood of what was heard; (pings, powers, places).

    Parameters
    ----------
    heard : PlaceReadings
        What the pings have of the places.
    log_power : (powers,) array
        Powers that an object may have.
    """
    kind, _, level, variance, weight, _ = heard
    best = np.log(np.maximum(level, 1e-30) / weight)
    likely = np.zeros((len(kind), len(log_power), kind.shape[1]))
    for index, of_ping in enumerate(likely):
        echo, silence = (np.flatnonzero(kind[index] == which) for which in (ECHO, SILENCE))
        off = best[index, echo] - log_power[:, np.newaxis]
        spread = variance[index, echo]
        density = -0.5 * (np.log(2.0 * np.pi * spread) + off**2 / spread)
        of_ping[:, echo] = np.maximum(density, LEAST_LOG_DENSITY)
        off = best[index, silence] - log_power[:, np.newaxis]
        of_ping[:, silence] = np.log(np.maximum(-np.expm1(-np.exp(off)), LEAST_SILENCE))
    return likely


def weigh_sources(
    heard: PlaceReadings, density: FloatArray, detection_probability: float, prior_log_odds: float
) -> FloatArray:
    """Log-odds of places, by belief propagation between them and the echoes.

    Parameters
    ----------
    heard : PlaceReadings
        What the pings have of the places.
    density : (pings, places) array
        By `densities`.
    detection_probability : float
        Probability that an object that is loud enough is heard.
    prior_log_odds : float
        Of a place.

    Returns
    -------
    log_odds : (places,) array
        That each holds an object.
    """
    log_odds = np.full(heard.kind.shape[1], prior_log_odds)
    messages = np.zeros(heard.kind.shape)
    missed = 1.0 - detection_probability
    for _ in range(ROUNDS):
        for index, at in enumerate(heard.bin):
            is_echo = heard.kind[index] == ECHO
            cavity = logistic(log_odds - messages[index])
            share = np.where(is_echo, cavity * density[index], 0.0)
            explained = CLUTTER_DENSITY + np.bincount(at, share)
            rest = np.where(is_echo, np.maximum(explained[at] - share, CLUTTER_DENSITY), 1.0)
            message = np.log(detection_probability * density[index] / rest + missed)
            message[heard.kind[index] == UNJUDGED] = 0.0
            message = DAMPING * messages[index] + (1.0 - DAMPING) * message
            log_odds += message - messages[index]
            messages[index] = message
    return log_odds
