"""What is free: where sound came back through, connected with where robots were."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from usmap_ros.mapping.joint.forward_model.power_estimation import power_limits
from usmap_ros.mapping.joint.forward_model.powers import Powers
from usmap_ros.mapping.joint.free_space.connected import connected, led_to, without_slits
from usmap_ros.mapping.joint.free_space.kinds import (
    FAINTER,
    GROUPS,
    KINDS,
    MIRRORS,
    ORIENTATIONS,
    OTHERS,
    ROUND,
)
from usmap_ros.mapping.joint.free_space.listening import (
    TRUSTED,
    listening_beside,
    scattering,
    trust,
)
from usmap_ros.mapping.joint.free_space.open_space import MOST_A_SECTOR, refute_surfaces
from usmap_ros.mapping.joint.free_space.refutation import OCCUPIED, Refuting, beliefs
from usmap_ros.mapping.joint.free_space.response import HeardBins
from usmap_ros.mapping.joint.free_space.unsaid import UNKNOWN, add_unsaid
from usmap_ros.mapping.joint.free_space.usual_directions import NEVER, facing, log_priors
from usmap_ros.mapping.joint.kept_pings import KeptPings
from usmap_ros.mapping.joint.surfaces.lines import NO_LINES
from usmap_ros.mapping.joint.surfaces.smooth_surfaces import SmoothSurfaces
from usmap_ros.mapping.joint.surfaces.walls import Walls
from usmap_ros.mapping.joint.visibility.field import Field, field_around
from usmap_ros.mapping.joint.visibility.open_ways import PROVING_SHARE, prove_open
from usmap_ros.mapping.joint.visibility.ray_casting import (
    RAYS,
    STEPS,
    WHOLE,
    changed_from,
    everything,
)
from usmap_ros.mapping.joint.visibility.soundings import INCIDENCES, LOUDNESSES
from usmap_ros.mapping.ping_bins import ECHO
from usmap_ros.mapping.ping_table import BIN_M, PingTable
from usmap_ros.numerics.arrays import BoolArray
from usmap_ros.parameters import MappingParameters
from usmap_ros.pings.cone import EchoCone

RESOLUTION_M = 0.05


def test_free_cells_that_nothing_leads_to_are_none() -> None:
    free, occupied = np.zeros((7, 20), bool), np.zeros((7, 20), bool)
    free[2:5, 1:5] = free[2:5, 6:9] = free[2:5, 10:13] = free[2:5, 16:19] = True
    # A wall between the second and the third; more than a cell or two between the last two.
    occupied[:, 9] = True
    stood = np.zeros_like(free)
    stood[3, 2] = True
    assert np.flatnonzero(connected(free, stood, occupied)[3]).tolist() == [1, 2, 3, 4, 6, 7, 8]


def test_slits_that_sound_alone_went_through_are_not_free() -> None:
    """A wall of glass was free, for what went along it came back from the one that it ends at."""
    free = np.zeros((20, 40), bool)
    free[5, 2:30] = free[10:13, 2:30] = free[15:19, 2:30] = True
    is_silent = np.zeros_like(free)
    is_silent[5, 8:14] = True
    left = without_slits(free, is_silent, RESOLUTION_M)
    assert np.flatnonzero(left[5]).tolist() == list(range(8, 14))
    assert not left[10:13].any()
    assert (left[15:19] == free[15:19]).all()


@pytest.mark.parametrize("has_walls", [False, True])
def test_among_walls_sound_that_came_back_leads_nowhere(has_walls: bool) -> None:
    free, stood, proven = (np.zeros((7, 20), bool) for _ in range(3))
    free[2:5, 1:5] = free[2:5, 12:16] = True
    stood[3, 2] = proven[3, 13] = True
    nothing, wall = np.zeros_like(free), np.array([[0.0, 1.0, 6.0, -19.0, 0.0]])
    lines = wall if has_walls else NO_LINES
    walls = Walls(nothing, nothing, nothing, lines, NO_LINES)
    beyond = [] if has_walls else [12, 13, 14, 15]
    assert np.flatnonzero(led_to(free, stood, proven, walls)[3]).tolist() == [1, 2, 3, 4, *beyond]


@pytest.mark.parametrize("shares", [[0.5], [0.5, 0.25], [0.5, 0.02]])
def test_ways_are_proven_by_the_share_of_an_echo_that_came_by_them(
    make_cone: Callable[..., EchoCone], shares: list[float]
) -> None:
    """On a grid of cells of 5 cm, from the origin eastwards."""
    kept = KeptPings(MappingParameters())
    kept.add(make_cone((2.0, 0.5)), "robot")
    table, rows, weights = kept.pings()[:3]
    field = field_around(table, rows, RESOLUTION_M)
    left = np.full((1, RAYS, STEPS), WHOLE, np.uint8)
    power, proven = np.zeros(field.shape, np.float32), np.zeros(field.shape, np.float32)
    expected = np.ones((1, table.kind.shape[1]), np.float32)

    def cell_at(x_m: float, y_m: float) -> tuple[int, int]:
        row, column = np.argwhere(field.cells_at(np.array([x_m]), np.array([y_m])))[0]
        return int(row), int(column)

    # Cells beside each other, as far away as the echo.
    for number, share in enumerate(shares):
        x_m, y_m = 1.975, RESOLUTION_M * (number + 0.5)
        loudness = table.power_gain[rows[0], 0] / (x_m**2 + y_m**2) ** 2
        bins = 1.1 * RESOLUTION_M / table.numbers[rows[0], BIN_M]
        power[cell_at(x_m, y_m)] = share * bins / loudness
    prove_open(table, rows, field, left, expected, power, proven, weights)
    near, behind = cell_at(0.51, 0.001), cell_at(2.2, 0.001)
    told = sum(share for share in shares if share >= PROVING_SHARE)
    assert proven[near] == pytest.approx(told, rel=0.1)
    assert proven[behind] == 0.0


def test_silence_and_sound_that_came_back_refute_surfaces_together() -> None:
    proven = np.array([[0.0, 0.0, 1.4, 1.6, 3.0, 3.0, 5.0]], np.float32)
    worst = np.zeros((1, 7, GROUPS), np.float32)
    worst[0, :, 1] = [-1.9, -2.1, -1.0, -1.0, -0.1, 1.0, 1.0]
    worst[0, :, MIRRORS] = worst[0, :, 1]
    # Each ping that came back says a third of what refutes mirrors, whatever refutes others.
    fails = Refuting(proven, -1.0, -2.0, 3.0).each(worst)
    assert fails[0, :, MIRRORS].tolist() == [False, True, False, True, True, False, True]
    assert fails[0, :, 1].tolist() == [True, True, True, True, True, False, True]


def test_what_echoes_from_several_sides_speak_for_holds_sound_back() -> None:
    hides, free = np.array([[True, False, False, False]]), np.array([[False, True, False, False]])
    worst = np.zeros((1, 4, GROUPS), np.float32)
    worst[0, :, 0], worst[0, 1, 2] = [9.0, 9.0, MOST_A_SECTOR, 2.0 * MOST_A_SECTOR], 9.0
    shown, open_, one_side, two_sides = beliefs(hides, free, worst, 0.05)[0]
    assert (shown, open_) == (OCCUPIED, 0.0)
    assert one_side == pytest.approx(0.05)
    assert 0.3 < two_sides < 0.5
    worst[0, 3, 1] = 50.0
    assert beliefs(hides, free, worst, 0.05)[0, 3] == OCCUPIED


def test_estimates_of_few_pings_and_of_lone_things_are_not_trusted() -> None:
    column, row = np.meshgrid(np.arange(20), np.arange(7))
    nothing, line = np.zeros((7, 20), bool), np.array([[0.0, 1.0, 3.0, -16.0, -2.0]])
    wall = Walls((row == 3) & (column >= 2) & (column <= 16), nothing, nothing, line, NO_LINES)
    told = [trust(pings, wall) for pings in (0.0, 100.0, 300.0, 1e4)]
    assert told == [0.0, 0.0, TRUSTED, TRUSTED]
    assert 0.0 < trust(150.0, wall) < trust(250.0, wall) < TRUSTED
    poles = Walls((row % 3 == 1) & (column % 5 == 1), nothing, nothing, NO_LINES, NO_LINES)
    assert trust(1e4, poles) == 0.0


def nothing_heard(table: PingTable) -> HeardBins:
    """All pings are silent."""
    silent = np.zeros(table.kind.shape, np.uint8)
    never = silent.astype(np.float32)
    limit = np.full(silent.shape, 1e-4, np.float32)
    return HeardBins(silent, never, never, limit, np.full(len(silent), FAINTER))


def one_ping_at_a_cell(
    make_cone: Callable[..., EchoCone],
) -> tuple[PingTable, NDArray[np.int64], Field, BoolArray, NDArray[np.uint8]]:
    """A ping, its row, its field, a cell a metre ahead, and all of its sound."""
    kept = KeptPings(MappingParameters())
    kept.add(make_cone(), "robot")
    table, rows, _ = kept.pings()[:3]
    field = field_around(table, rows, RESOLUTION_M)
    wanted = field.cells_at(np.array([1.0]), np.array([0.0]))
    return table, rows, field, wanted, np.full((len(rows), RAYS, STEPS), WHOLE, np.uint8)


@pytest.mark.parametrize("fainter", [0, FAINTER])
def test_silence_refutes_what_is_round_as_it_does_what_is_so_much_louder(
    fainter: int, make_cone: Callable[..., EchoCone]
) -> None:
    """Who reports ranges alone hears a column nearby as surely as a wall."""
    table, rows, field, wanted, left = one_ping_at_a_cell(make_cone)
    listening = nothing_heard(table)
    listening.fainter[:] = fainter
    # The fainter something is the less its silence says.
    log_silent = np.repeat(-0.1 * np.arange(LOUDNESSES)[:, np.newaxis], INCIDENCES, axis=1)
    kinds = np.full((KINDS, 3), [0.0, NEVER, OTHERS])
    kinds[ROUND, 1] = 0.0

    def told(those: np.ndarray) -> float:
        worst = np.zeros((*field.shape, GROUPS), np.float32)
        refute_surfaces(
            table, rows, field, left, listening, log_silent, 9.0, those,
            np.zeros(field.shape, np.float32), np.ones(field.shape, bool), wanted,
            everything(len(rows)), worst,
        )  # fmt: skip
        return float(worst[wanted][0, OTHERS])

    flat = kinds.copy()
    flat[0], flat[ROUND, 1] = (0.0, 0.0, OTHERS), NEVER
    fainter_by = told(kinds) - told(flat)
    assert (fainter_by > 0.2) is (fainter > 0)
    assert told(kinds) < -0.1


def test_echoes_of_what_is_estimated_elsewhere_speak_for_little(
    make_cone: Callable[..., EchoCone],
) -> None:
    """A ping with an echo, and a cell at its range: it may be of that, if that scatters at all."""
    table, rows, field, wanted, left = one_ping_at_a_cell(make_cone)
    kinds = log_priors(facing([], NO_LINES, RESOLUTION_M), 0, 0.0, 8, 0.0, 0.5)
    silence = nothing_heard(table)
    heard = silence._replace(
        heard=np.ones_like(silence.heard), likely=np.full_like(silence.chance, 0.7)
    )

    def told(listening: HeardBins, scatters: bool) -> float:
        worst = np.zeros((*field.shape, GROUPS), np.float32)
        refute_surfaces(
            table, rows, field, left, listening, np.full((LOUDNESSES, INCIDENCES), -2.0), 9.0,
            kinds, np.zeros(field.shape, np.float32), np.full(field.shape, scatters), wanted,
            everything(len(rows)), worst,
        )  # fmt: skip
        return float(worst[wanted][0, OTHERS])

    own, others = (told(heard, scatters) for scatters in (True, False))
    # What is likely at its range anyhow says nearly nothing, and what is not speaks for a surface.
    assert others < own - 1.0
    assert told(silence, False) == told(silence, True) < others
    # By the most of what it could say: that all of it is heard.
    usual = told(silence._replace(heard=heard.heard, chance=np.ones_like(heard.chance)), True)
    assert usual < others < usual - np.log(0.7)


def test_estimates_that_are_not_shown_make_echoes_likely_elsewhere(
    make_cone: Callable[..., EchoCone],
) -> None:
    """A thing that three pings heard from different sides."""
    kept = KeptPings(MappingParameters())
    for turn in (0.0, 0.5, 1.0):
        from_m = 1.0 - np.cos(turn), -np.sin(turn)
        kept.add(make_cone((1.0, 0.3), x_m=from_m[0], y_m=from_m[1], yaw_rad=turn), "robot")
    pings = kept.pings()
    field = field_around(pings.table, pings.rows, RESOLUTION_M)
    limits = power_limits(pings.table, pings.rows)
    powers = Powers(pings.table, pings.rows, pings.weights, field, limits)
    powers.start()
    powers.sweep(10)
    nothing = np.zeros(field.shape, bool)

    def listen(first_only: bool) -> HeardBins:
        return listening_beside(
            Walls(nothing, nothing, nothing, NO_LINES, NO_LINES),
            SmoothSurfaces(pings.table, pings.rows, pings.echoes, field), powers,
            pings.table.numbers[pings.rows], pings.rows, np.full(len(pings.rows), first_only),
            RESOLUTION_M, TRUSTED,
        )  # fmt: skip

    listening = listen(first_only=False)
    assert (listening.fainter == FAINTER).all()
    assert not listen(first_only=True).fainter.any()
    is_echo = pings.table.kind[pings.rows] == ECHO
    assert listening.chance[is_echo].max() < 0.1
    assert listening.likely[is_echo] == pytest.approx(TRUSTED)
    assert (listening.likely >= listening.chance).all()
    scatters = scattering(powers)
    assert scatters[field.cells_at(np.array([1.0]), np.array([0.0]))].all()
    # As far from the first of them, where the others hear nothing.
    assert not scatters[field.cells_at(np.array([0.9]), np.array([0.43]))].any()


def test_silence_refutes_mirrors_where_they_would_have_been_struck_squarely(
    make_cone: Callable[..., EchoCone],
) -> None:
    """Two silent pings at a cell, and a mirror there that faces one of them."""
    kept = KeptPings(MappingParameters())
    kept.add(make_cone(y_m=1.0, x_m=1.0, yaw_rad=-0.5 * np.pi), "robot")
    kept.add(make_cone(), "robot")
    table, rows, _ = kept.pings()[:3]
    field = field_around(table, rows, RESOLUTION_M)
    wanted = field.cells_at(np.array([1.0]), np.array([0.0]))
    left = np.full((len(rows), RAYS, STEPS), WHOLE, np.uint8)
    listening = nothing_heard(table)
    kinds = log_priors(facing([], NO_LINES, RESOLUTION_M), 0, 0.0, 8, 0.0, 0.5)
    kinds[ORIENTATIONS + 1 : ROUND, 1] = NEVER

    likelier, anywhere = np.zeros(field.shape, np.float32), np.ones(field.shape, bool)

    def told_of_mirrors(some: slice) -> float:
        worst = np.zeros((*field.shape, GROUPS), np.float32)
        log_silent, changed = np.full((LOUDNESSES, INCIDENCES), -2.0), everything(len(rows))
        refute_surfaces(
            table, rows[some], field, left[some], listening, log_silent, 9.0, kinds, likelier,
            anywhere, wanted, changed[some], worst,
        )  # fmt: skip
        assert worst[wanted][0, OTHERS] < -1.0
        return float(worst[wanted][0, MIRRORS])

    aslant, square = sorted((told_of_mirrors(slice(0, 1)), told_of_mirrors(slice(1, 2))))[::-1]
    assert aslant == pytest.approx(np.log(0.5))
    assert square < aslant - 1.0
    assert told_of_mirrors(slice(0, 2)) == pytest.approx(square)
    # Where they are as likely as anything, as much more must be heard.
    likelier[:] = 0.5
    assert told_of_mirrors(slice(0, 2)) == pytest.approx(square + 0.5)


def test_what_is_heard_of_surfaces_changes_where_sound_does(
    make_cone: Callable[..., EchoCone],
) -> None:
    """Blocks of cells that the same sound reaches as before are left as they were."""
    kept = KeptPings(MappingParameters())
    for number in range(6):
        kept.add(make_cone(x_m=0.4 * number, yaw_rad=0.7 * number), "robot")
    table, rows, _ = kept.pings()[:3]
    field = field_around(table, rows, RESOLUTION_M)
    listening = nothing_heard(table)
    kinds = log_priors(facing([], NO_LINES, RESOLUTION_M), 0, 0.0, 8, 0.0, 0.5)
    log_silent = np.full((LOUDNESSES, INCIDENCES), -2.0)
    wanted, likelier = np.ones(field.shape, bool), np.zeros(field.shape, np.float32)

    def refute(left: np.ndarray, changed: np.ndarray, worst: np.ndarray) -> np.ndarray:
        refute_surfaces(
            table, rows, field, left, listening, log_silent, 9.0, kinds, likelier, wanted, wanted,
            changed, worst,
        )  # fmt: skip
        return worst

    before = np.full((len(rows), RAYS, STEPS), WHOLE, np.uint8)
    left = before.copy()
    left[2, RAYS // 3 : RAYS // 2, STEPS // 2 + 3 :] = WHOLE // 2
    left[4, :3, 5:] = 0
    changed, nothing = changed_from(left, before), np.full((len(rows), RAYS), STEPS)
    assert (changed[2, RAYS // 3 : RAYS // 2] == STEPS // 2).all()
    assert (changed[4, :3] == 0).all()
    assert (changed[[0, 1, 3, 5]] == STEPS).all()
    said, none = (np.zeros((*field.shape, GROUPS), np.float32) for _ in range(2))
    refute(before, everything(len(rows)), said)
    anew = refute(left, everything(len(rows)), none)
    assert (anew != said).any()
    np.testing.assert_array_equal(refute(left, changed, said.copy()), anew)
    # Were nothing to have changed, nothing would be looked at.
    np.testing.assert_array_equal(refute(left, nothing.astype(np.uint8), said.copy()), said)


def test_surfaces_rise_by_no_more_than_what_is_said_no_more(
    make_cone: Callable[..., EchoCone],
) -> None:
    """What would be refuted without it is refuted, and nobody has to look."""
    kept, rng = KeptPings(MappingParameters()), np.random.default_rng(5)
    for number in range(24):
        kept.add(make_cone(x_m=0.1 * number, yaw_rad=0.7 * number), "robot")
    table, rows, _ = kept.pings()[:3]
    field = field_around(table, rows, RESOLUTION_M)
    silence = nothing_heard(table)
    heard = (rng.random(silence.heard.shape) < 0.05).astype(np.uint8)
    listening = silence._replace(heard=heard, likely=rng.random(heard.shape).astype(np.float32))
    kinds = log_priors(facing([], NO_LINES, RESOLUTION_M), 0, 0.0, 8, 0.0, 0.5)
    log_silent = -1.0 - 0.2 * rng.random((LOUDNESSES, INCIDENCES))
    wanted, likelier = np.ones(field.shape, bool), np.zeros(field.shape, np.float32)
    before = rng.integers(WHOLE // 2, WHOLE, (len(rows), RAYS, STEPS)).astype(np.uint8)
    left = before.copy()
    left[:, RAYS // 3 : RAYS // 2, STEPS // 2 :] //= 2
    left[4, :3, 5:] = 0

    def said(left: np.ndarray) -> np.ndarray:
        worst = np.zeros((*field.shape, GROUPS), np.float32)
        refute_surfaces(
            table, rows, field, left, listening, log_silent, 2.0, kinds, likelier, wanted, wanted,
            everything(len(rows)), worst,
        )  # fmt: skip
        return worst

    def unsaid(left: np.ndarray) -> np.ndarray:
        most = np.zeros(field.shape, np.float32)
        add_unsaid(
            table, rows, field, before, left, listening.limit, log_silent, wanted,
            changed_from(left, before), most,
        )  # fmt: skip
        return most

    less, rise = unsaid(left), (said(left) - said(before)).max(axis=2)
    assert less.max() < UNKNOWN
    assert (rise <= less + 1e-4).all()
    assert rise.max() > 0.5
    assert (rise[less == 0.0] == 0.0).all()
    # Of most that rise, it is not much more.
    rises = rise > 0.1
    assert np.median(less[rises] / rise[rises]) < 3.0
    # How much more echoes would say, if more of the sound got there, is not told.
    assert unsaid(np.full_like(before, WHOLE)).max() >= UNKNOWN
    assert not unsaid(before).any()
