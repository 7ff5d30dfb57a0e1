"""Which share of the surfaces of a place may be mirrors, by those that were looked at aslant.

Where all walls that were found answer from any side, the next one may still be of glass: mirrors
are seldom found, for somebody must have struck them squarely.  If a share π of all surfaces are
mirrors and a share q of surfaces is struck squarely, what is found is a mirror with probability
π q / (π q + 1 - π).  Walls that were found, each a mirror or none by how it answers aslant, say how
likely each π is: little where there are few, and nothing where no wall was struck squarely.
"""

import numpy as np
from numpy.typing import NDArray

from usmap_ros.mapping.joint.free_space.open_rays import EXPLAINED
from usmap_ros.mapping.joint.free_space.response import NO_NORMAL, SurfaceViews
from usmap_ros.mapping.joint.visibility.soundings import SECTORS
from usmap_ros.numerics.arrays import BoolArray, FloatArray

#: Classes of incidence below which a look is square, and those that are aslant.
SQUARE, ASLANT = 3, slice(4, 6)
#: P(silent | struck squarely) below which surfaces are loud enough to tell; and steps of loudness
#: above that at which rough ones answer aslant, too, as they do 3 to 9 dB fainter.
TELLING_SILENCE, LOUDER = 0.4, 3
#: Answers aslant, over those to square looks, below which a wall is a mirror and above which it is
#: none; looks aslant, and cells, of which a wall counts half: short ones are often none.
MIRROR, SCATTERER, ENOUGH_LOOKS, ENOUGH_CELLS = 0.05, 0.25, 5.0, 8.0
#: Mean axis of the directions from which something is heard, below which that is several sides and
#: above which it is one: those that are spread evenly over 60 and 30 degrees.
FROM_ASIDE, FROM_ONE_SIDE = 0.83, 0.95
#: How far a place was looked at from one side only, beyond which nothing alone tells of others.
MOSTLY = 0.5
#: Pings from which on it tells that nothing was heard from several sides: few hear poles from one.
TELLING_PINGS = 100
#: Share of the nearer half of all echoes that is left unexplained among poles, and by which nothing
#: but mirrors may be there.
#: Of 120 recordings of 60 to 300 pings among poles, 116 left less than 0.25; of 19 in rooms of
#: mirrors, of which no wall was found by that many pings, 17 left as much.
OF_POLES, OF_MIRRORS = 0.15, 0.45
#: Things that tell nothing of what a place is made of, and those from which on these shares hold:
#: of fewer, less may be left over, and a tenth of the shares at the least.
FEW_THINGS, MANY_THINGS, LEAST_TOLD = 4, 6, 0.1
#: Shares of all echoes of `ENOUGH_PINGS`, near or far, that are left among poles and where nothing
#: but mirrors may be: of 20 recordings of 90 to 300 pings among poles, none left more than 0.24;
#: where walls are heard aslant alone, few things by chance explain the nearer half of them, and
#: 0.62 to 0.71 are left.
ALL_OF_POLES, ALL_OF_MIRRORS = 0.3, 0.55
#: Echoes below which hardly any may be left unexplained, and the share of mirrors where more are.
LEAST_ECHOES, HARDLY_ANY, UNKNOWN_SHARE = 60, 0.05, 0.5
#: Pings from which on what else is there would have shown itself: few things, and few echoes, tell
#: as much as many.
ENOUGH_PINGS = 2 * TELLING_PINGS
#: Walls of which none is a mirror that tell nothing of others, where many have not been heard, and
#: those that do: a room has four.
FEW_WALLS = (1, 4)
#: A wall ends where its cells are farther apart than this.
APART_CELLS = 10.0
#: Shares that are compared, and how likely they are before anything was heard: a Beta distribution.
#: With less for others, two or three walls that one robot heard in a room of rough ones would not
#: do to say that there are hardly any mirrors, and half of what it saw would stay unknown.
SHARES = np.linspace(0.005, 0.995, 100)
MIRRORS_BEFORE, OTHERS_BEFORE = 0.1, 3.0


def mirror_share(
    views: SurfaceViews,
    surfaces: FloatArray,
    log_silent: FloatArray,
    lone_share: float,
    least: float = 0.0,
) -> float:
    """Share of surfaces that are expected to be mirrors.

    Parameters
    ----------
    views, surfaces
        By and as in `usmap_ros.mapping.joint.free_space.response.look_at`.
    log_silent : (LOUDNESSES, INCIDENCES) array
        Logarithm of P(silent | surface).
    lone_share : float
        How far what stands alone, and answers from any side, tells what else stands here.
    least : float
        How many mirrors there are at least, whatever was heard aslant.
    """
    has_normal = surfaces[:, 2] != NO_NORMAL
    others = lone_share * np.count_nonzero(~has_normal)
    mirrors, scatterers, is_struck = _told_apart(views, surfaces, log_silent, has_normal)
    struck = (np.count_nonzero(is_struck) + 1.0) / (np.count_nonzero(has_normal) + 2.0)
    return expected_share(max(mirrors, least), scatterers + others, struck)


def expected_share(mirrors: float, others: float, struck: float) -> float:
    """Mean of the share of mirrors, by how many things were found that are mirrors or are not.

    Parameters
    ----------
    mirrors, others : float
        That were found.
    struck : float
        Share of surfaces that are struck squarely, and so found if they are mirrors.
    """
    log_found = np.log(SHARES * struck + 1.0 - SHARES)
    likelihood = (mirrors + MIRRORS_BEFORE - 1.0) * np.log(SHARES) + mirrors * np.log(struck)
    likelihood += (others + OTHERS_BEFORE - 1.0) * np.log1p(-SHARES)
    likelihood -= (mirrors + others) * log_found
    weights = np.exp(likelihood - likelihood.max())
    return float(weights @ SHARES / weights.sum())


def unexplained_share(
    chances: NDArray[np.float32],
    ranges_m: FloatArray,
    things: int,
    pings: int,
    lone_share: float,
) -> float:
    """Share of surfaces that may be mirrors, by echoes that nothing explains.

    Pings strike a mirror in a few places, each of them from one side: what they hear fits no point
    that all of them should have heard, and nothing is shown.  Poles explain what they return, but
    for those that are far off, which few pings hear: so the nearer half of the echoes tells, and
    all of them where pings are many.  And where few things were found by few pings, there is little
    to say that the place is one of poles.

    Parameters
    ----------
    chances : (echoes,) float32 array
        How likely each echo was by what stands.
    ranges_m : (echoes,) array
        From how far it came.
    things : int
        How many things were found.
    pings : int
        How many there are.
    lone_share : float
        How far a place is one of lone things: walls that were found tell of themselves.
    """
    if not len(chances):
        return 0.0
    is_unexplained, told, every = chances <= EXPLAINED, 1.0, 0.0
    if pings < ENOUGH_PINGS:
        if len(chances) < LEAST_ECHOES:
            return UNKNOWN_SHARE * lone_share * bool(is_unexplained.mean() > HARDLY_ANY)
        told = min(max((things - FEW_THINGS) / (MANY_THINGS - FEW_THINGS), LEAST_TOLD), 1.0)
    else:
        every = np.interp(is_unexplained.mean(), (ALL_OF_POLES, ALL_OF_MIRRORS), (0.0, 1.0))
    nearer = float(is_unexplained[ranges_m <= np.median(ranges_m)].mean()) / told
    return lone_share * float(max(np.interp(nearer, (OF_POLES, OF_MIRRORS), (0.0, 1.0)), every))


def told_by_walls(walled: float, walls: int, wide: float) -> float:
    """How far walls that were found, none of which is a mirror, tell what others are.

    Where one end of a corridor was heard, and most of what was sent along it did not come back, its
    sides may be anything: over 0.8 m² beyond them were free.

    Parameters
    ----------
    walled : float
        How far a place is one of walls.
    walls : int
        How many were found.
    wide : float
        How far more rays end at nothing than in rooms.
    """
    return walled * (1.0 - wide * float(np.interp(walls, FEW_WALLS, (1.0, 0.0))))


def facing_who_heard(
    views: SurfaceViews, surfaces: FloatArray, pings: int, one_sided: float = 0.0
) -> FloatArray:
    """Surfaces of which nobody knows how they face, facing who heard them if they may be mirrors.

    What is heard from one side only may be a mirror that is struck squarely from there: in a
    place where nothing was heard from several sides, silence aslant says nothing of anything.

    Parameters
    ----------
    views, surfaces
        By and as in `usmap_ros.mapping.joint.free_space.response.look_at`.
    pings : int
        How many there are.
    one_sided : float
        How far the place was looked at from one side only: if it was, nothing that stands alone
        tells how it answers from others.

    Returns
    -------
    surfaces : (surfaces, 3) array
        The same, but for directions.
    """
    if pings < TELLING_PINGS:
        return surfaces
    heard, table = (
        _axes(views, some, len(surfaces)) for some in (views.heard > 0, views.heard >= 0)
    )
    is_lone = (surfaces[:, 2] == NO_NORMAL) & (heard != 0.0)
    from_aside = is_lone & (np.abs(heard) < FROM_ASIDE)
    silent_aslant = is_lone & (np.abs(heard) > FROM_ONE_SIDE) & (np.abs(table) < FROM_ASIDE)
    if one_sided > MOSTLY:
        is_faced = is_lone
    elif np.count_nonzero(from_aside) > np.count_nonzero(silent_aslant):
        return surfaces
    else:
        is_faced = is_lone & ~from_aside
    facing = surfaces.copy()
    facing[is_faced, 2] = 0.5 * np.angle(heard[is_faced])
    return facing


def _axes(views: SurfaceViews, some: BoolArray, count: int) -> NDArray[np.complex128]:
    """Mean of the axes of view of some looks at each surface: of length 1 if all are the same."""
    twice_rad = 4.0 * np.pi * (views.sector[some] + 0.5) / SECTORS
    which, number = views.surface[some], np.bincount(views.surface[some], minlength=count)
    cosine, sine = (np.bincount(which, part(twice_rad), count) for part in (np.cos, np.sin))
    return np.asarray((cosine + 1.0j * sine) / np.maximum(number, 1), np.complex128)


def _told_apart(
    views: SurfaceViews, surfaces: FloatArray, log_silent: FloatArray, has_normal: BoolArray
) -> tuple[float, float, BoolArray]:
    """How many walls are mirrors, how many are not, and which surfaces were struck squarely."""
    wall, tells = _numbers(surfaces), log_silent[:, 1] < np.log(TELLING_SILENCE)
    is_loud = tells[views.loud] & has_normal[views.surface]
    is_square = is_loud & (views.incidence < SQUARE)
    is_aslant = is_loud & (views.incidence >= ASLANT.start) & (views.incidence < ASLANT.stop)
    is_louder = is_aslant & tells[np.maximum(views.loud, LOUDER) - LOUDER]
    number = wall[views.surface]
    louder = np.bincount(number[is_louder], minlength=len(surfaces))
    is_aslant &= is_louder | (louder < ENOUGH_LOOKS)[number]
    is_struck = np.zeros(len(surfaces), bool)
    is_struck[views.surface[is_square]] = True
    square, square_looks = _answers(views, wall, is_square, log_silent)
    aslant, table = _answers(views, wall, is_aslant, log_silent)
    is_mirror = np.clip((SCATTERER - aslant / square) / (SCATTERER - MIRROR), 0.0, 1.0)
    # Who strikes no mirror squarely does not find it: what is found aslant answers aslant.
    is_mirror *= square_looks / (square_looks + ENOUGH_LOOKS)
    cells = np.bincount(wall).astype(np.float64)
    told = table / (table + ENOUGH_LOOKS) * cells / (cells + ENOUGH_CELLS)
    return float(told @ is_mirror), float(told @ (1.0 - is_mirror)), is_struck


def _numbers(surfaces: FloatArray) -> NDArray[np.int64]:
    """Number of the wall that each surface is on: they come wall by wall."""
    steps = np.diff(surfaces, axis=0)
    is_new = (steps[:, 2] != 0.0) | (np.abs(steps[:, :2]).max(axis=1, initial=0.0) > APART_CELLS)
    return np.concatenate([np.zeros(min(1, len(surfaces)), np.int64), np.cumsum(is_new)])


def _answers(
    views: SurfaceViews, wall: NDArray[np.int64], some: BoolArray, log_silent: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """How often each wall answers some looks, over as often as if all were square; and looks."""
    number, walls = wall[views.surface[some]], int(wall.max(initial=-1)) + 1
    beside = views.beside[some]
    silent, by_chance, expected = (
        np.bincount(number, weights, walls) + 0.5
        for weights in (
            views.heard[some] == 0,
            beside,
            beside * np.exp(log_silent[views.loud[some], 1]),
        )
    )
    answers = np.clip(1.0 - silent / by_chance, 0.02, 1.0)
    if_square = np.clip(1.0 - expected / by_chance, 0.02, 1.0)
    return answers / if_square, np.bincount(number, minlength=walls).astype(np.float64)
