"""How far answers of surfaces keep up from square to flat incidence, at each loudness.

Rough walls answer from any side, and so does silence aslant speak against them; but less so the
flatter sound comes in and the fainter its answer is, and by how much less differs from place to
place.
"""

import numpy as np

from usmap_ros.numerics.arrays import FloatArray

#: Classes of square incidence.
SQUARE = slice(1, 3)
#: Looks from which a share is learnt at least.
LEAST_LOOKS = 200.0
#: Answers to sound at 56 to 67 and at 67 to 79 degrees, over those to square sound, up to which
#: silence at such angles and flatter ones says what it was heard to say, and from which on what it
#: does of rough walls.  Walls that are bent by a tenth of the wavelength, as the wave equation has
#: them, answer at the one and not at the other: halfrough of `benchmarks/wave_equation.py` comes to
#: 0.23 and 0.06.  18 of own rough scenes come to 0.32 and 0.11 at least.
FADING = {5: (0.22, 0.3), 6: (0.06, 0.1)}
#: The same of looks that are about as loud as each other, at least so many: steps to either side.
#: What is loud may answer as rough walls do, and what is faint not at all: in a public simulator
#: 900 looks of the fainter half come to 0.00 and 0.00, in twelve own rough scenes to 0.10 and 0.02
#: at the least.
FADING_AS_LOUD = {5: (0.03, 0.1), 6: (0.008, 0.02)}
AS_LOUD, LEAST_AS_LOUD = 2, 50.0
#: Class of loudness below which hardly anything answers aslant anywhere: taken as what is so loud.
FAINTEST = 6
#: Share of all looks below which hardly any was so flat, where a place was seen from one side.
HARDLY_ANY = 0.08


def kept_up(
    as_heard: FloatArray, p_silent: FloatArray, looks: FloatArray, one_sided: float
) -> FloatArray:
    """How far answers keep up, by `FADING` and `FADING_AS_LOUD`.

    Parameters
    ----------
    as_heard : (LOUDNESSES, INCIDENCES) array
        P(silent | surface), as each class of looks has it by itself.
    p_silent : (LOUDNESSES, INCIDENCES) array
        The same, where what is louder or struck more squarely is not more often silent.
    looks : (LOUDNESSES, INCIDENCES) array
        How many there are of each class.
    one_sided : float
        How far the place was looked at from one side only.

    Returns
    -------
    kept_up : (LOUDNESSES, INCIDENCES) array
        From 0, where they do not, to 1.
    """
    as_far = np.ones_like(as_heard)
    for incidence, bounds in FADING.items():
        answers, own = 1.0 - as_heard[:, incidence], looks[:, incidence]
        share = over_square(answers, own, p_silent)
        if share is not None:
            usual = float(np.interp(share, bounds, (0.0, 1.0)))
        else:
            is_rare = looks[:, incidence:].sum() < HARDLY_ANY * looks.sum()
            usual = 1.0 - one_sided * is_rare
        as_loud = np.minimum(usual, _fading_as_loud(incidence, answers, own, p_silent))
        as_far[:, incidence:] = np.minimum(as_far[:, incidence:], as_loud[:, np.newaxis])
    return as_far


def _fading_as_loud(
    incidence: int, answers: FloatArray, looks: FloatArray, p_silent: FloatArray
) -> FloatArray:
    """How far answers of each loudness keep up to a class of incidence, 1 where looks are few."""
    as_far = np.ones(len(looks))
    for loud in range(len(looks)):
        near = slice(max(0, loud - AS_LOUD), loud + AS_LOUD + 1)
        share = over_square(answers[near], looks[near], p_silent[near], LEAST_AS_LOUD)
        if share is not None:
            as_far[loud] = np.interp(share, FADING_AS_LOUD[incidence], (0.0, 1.0))
    as_far[:FAINTEST] = as_far[FAINTEST]
    return as_far


def over_square(
    answers: FloatArray, looks: FloatArray, p_silent: FloatArray, least: float = LEAST_LOOKS
) -> float | None:
    """Answers to looks over those to as many square ones, all by loudness; None if looks are few.

    Only where square sound is answered at all.

    Parameters
    ----------
    answers, looks : (loudnesses,) arrays
        Share of looks of some incidence that are answered, and how many there are.
    p_silent : (loudnesses, INCIDENCES) array
        P(silent | surface).
    least : float
        Looks below which they are few.
    """
    views = looks * (p_silent[:, 1] < 0.7)
    if views.sum() <= least:
        return None
    square = (views * (1.0 - p_silent[:, SQUARE]).mean(axis=1)).sum()
    return float((views * answers).sum() / max(square, 1e-9))
