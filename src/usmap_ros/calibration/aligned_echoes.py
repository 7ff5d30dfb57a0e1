"""Echoes of one pulse, shifted and scaled onto one another.

All of them are the same pulse, later and weaker or stronger, and some have others beside them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usmap_ros.numerics.arrays import FloatArray, Signal

#: Points of the template to each baseband sample.
FINER = 8
#: Rounds of shifting and averaging, and share of the echoes that are kept: those least like the
#: mean have others beside them.
_ROUNDS, _KEPT = 5, 0.6
#: Misfit of an echo that nothing is beside, and below which none counts more for being smaller.
_LONE = 0.02
#: Echoes that are told apart in the neighbourhood of the strongest, itself among them, and rounds
#: in which each is fitted beside the others.
_ECHOES, _SWEEPS = 4, 2


@dataclass(frozen=True)
class AlignedEchoes:
    """Echoes on the template's grid, shifted and scaled to it: (echoes, points) and (points,).

    `echoes` and `misfits` are of those that the template is the weighted mean of, freed of others
    beside them; `crowded` are all, with what is beside them.
    """

    echoes: Signal
    template: Signal
    misfits: FloatArray
    crowded: Signal


def align(snippets: Signal, apart: int) -> AlignedEchoes:
    """Shift and scale echoes onto their mean, without others beside them, and average anew.

    Parameters
    ----------
    snippets : (echoes, samples) array
        Around the loudest sample of each.
    apart : int
        Samples from an echo from which on another one is told from an error of the mean.
    """
    count, samples = snippets.shape
    spectra = np.fft.fft(snippets, 2 * samples, axis=1)
    peak = np.abs(snippets).argmax(axis=1)
    scaled = snippets / snippets[np.arange(count), peak][:, np.newaxis]
    template = np.median(scaled.real, axis=0) + 1j * np.median(scaled.imag, axis=0)
    kept = np.ones(count, dtype=bool)
    shifted, crowded, misfits = scaled, scaled, np.zeros(count)
    for _ in range(_ROUNDS):
        shifted, crowded, misfits = _onto(spectra, template, apart)
        kept = misfits <= np.quantile(misfits, _KEPT)
        # The loneliest count most: of walls, few echoes have none beside them.
        weights = np.maximum(misfits[kept], _LONE) ** -2.0
        template = weights @ shifted[kept] / weights.sum()
    fine = _finer(template[np.newaxis])[0]
    return AlignedEchoes(_finer(shifted[kept]), fine, misfits[kept], _finer(crowded))


def misfits(snippets: Signal, templates: Sequence[Signal], apart: int) -> FloatArray:
    """What the best template leaves of each echo that it explains well, as `align` of its own."""
    spectra = np.fft.fft(snippets, 2 * snippets.shape[1], axis=1)
    left: FloatArray = np.min([_onto(spectra, one, apart)[2] for one in templates], axis=0)
    return left[left <= np.quantile(left, _KEPT)]


def _onto(spectra: Signal, template: Signal, apart: int) -> tuple[Signal, Signal, FloatArray]:
    """Echoes freed of others, shifted by parts of a sample and scaled to fit a template.

    Returns them, (echoes, samples), the same with the others, and the norm of what the template
    leaves of each that is freed.
    """
    samples, width = len(template), spectra.shape[1]
    frequency = np.fft.fftfreq(width)
    reference = np.fft.fft(template, width)
    energy = np.vdot(template, template).real
    lags = np.zeros((_ECHOES, len(spectra)))
    parts = np.zeros((_ECHOES, *spectra.shape), dtype=np.complex128)
    for _ in range(_SWEEPS):
        for number in range(_ECHOES):
            rest = spectra - parts.sum(axis=0) + parts[number]
            # The first one is where it fits best, and the others not so near that they would take
            # an error of the template for an echo.
            near = (lags[0], apart) if number else None
            lags[number], scale = _best_place(rest, reference, near)
            turned = np.exp(-2j * np.pi * frequency * lags[number][:, np.newaxis])
            parts[number] = (scale / energy)[:, np.newaxis] * reference * turned
    alone = spectra - parts[1:].sum(axis=0)
    turned = np.exp(2j * np.pi * frequency * lags[0][:, np.newaxis])
    shifted: Signal = np.fft.ifft(alone * turned, axis=1)[:, :samples]
    scales = ((shifted @ template.conj()) / energy)[:, np.newaxis]
    crowded: Signal = np.fft.ifft(spectra * turned, axis=1)[:, :samples] / scales
    shifted = shifted / scales
    left_over = np.linalg.norm(shifted - template, axis=1) / np.sqrt(energy)
    return shifted, crowded, left_over


def _best_place(
    spectra: Signal, reference: Signal, away_from: tuple[FloatArray, int] | None
) -> tuple[FloatArray, Signal]:
    """Lag (samples, with parts) at which a template fits each signal best, and its product there.

    Not within so many samples of given lags, if any are.
    """
    width = spectra.shape[1]
    crossed = spectra * reference.conj()
    finer = np.zeros((len(spectra), FINER * width), dtype=np.complex128)
    half = width // 2
    finer[:, :half], finer[:, -half:] = crossed[:, :half], crossed[:, -half:]
    product = FINER * np.fft.ifft(finer, axis=1)
    correlation = np.abs(product)
    if away_from is not None:
        lags, apart = away_from
        places = np.arange(correlation.shape[1]) / FINER
        distance = np.abs(places - lags[:, np.newaxis])
        correlation[np.minimum(distance, width - distance) < apart] = 0.0
    best = correlation.argmax(axis=1)
    rows, count = np.arange(len(best)), correlation.shape[1]
    left, middle, right = (correlation[rows, (best + step) % count] for step in (-1, 0, 1))
    bend = np.minimum(left - 2.0 * middle + right, -np.finfo(float).tiny)
    part = np.clip(0.5 * (left - right) / bend, -0.5, 0.5)
    return (best + part) / FINER, product[rows, best]


def _finer(signals: Signal) -> Signal:
    """The same with `FINER` points a sample, band-limited."""
    count, samples = signals.shape
    spectra = np.fft.fft(signals, axis=1)
    wide = np.zeros((count, FINER * samples), dtype=np.complex128)
    half = (samples + 1) // 2
    wide[:, :half], wide[:, half - samples :] = spectra[:, :half], spectra[:, half:]
    finer: Signal = FINER * np.fft.ifft(wide, axis=1)
    return finer
