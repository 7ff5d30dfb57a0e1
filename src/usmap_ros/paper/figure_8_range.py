"""Over what range of settings the caption of figure 8 comes out.

The paper leaves open what the frequency is, how long the pulse, how fast the sampling, how hard
the floor, where the objects stand, and how far they are from the centres of their cells.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from usmap_ros.acoustics.propagation import Channel
from usmap_ros.acoustics.pulse import Pulse, PulseShape
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.paper.figures_7_8 import caption, in_phase, interfere_as_described
from usmap_ros.paper.part import Part
from usmap_ros.paper.setting import (
    AIR,
    ALIGNED,
    CELL_M,
    CENTRES,
    CONCRETE,
    SINE,
    Points,
    SampledPulse,
    hear,
    method,
)
from usmap_ros.pings.trace import Encoding
from usmap_ros.plotting.style import FAINT, ROBOTS, new_figure, styled
from usmap_ros.reconstruction.cell_dictionary import CellDictionary
from usmap_ros.reconstruction.cells import explain

#: Offsets of the objects from the centres of their cells, in wavelengths.
OFFSETS = (0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.2)
#: Settings drawn about the one of figure 8, and at random.
NEAR_SETTINGS, RANDOM_SETTINGS = 20, 24
#: Cells from which random scenes take their near, middle and far object.
NEAR: Points = ((1.5, 1.5), (1.5, 2.5), (1.5, 3.5), (2.5, 3.5))
MIDDLE: Points = ((-0.5, 4.5), (-1.5, 4.5), (-0.5, 5.5), (-1.5, 5.5))
FAR: Points = ((0.5, 6.5), (0.5, 7.5))
ALL = "all of them"


@dataclass(frozen=True)
class Setting:
    """What the paper leaves open, chosen in one way."""

    carrier_hz: float
    duration_s: float
    samples_per_cycle: float
    #: Of the floor, as an amplitude.
    reflectivity: float
    #: (3, 2) array-like: cells of the near, middle and far object.
    centres: Points

    @property
    def listening(self) -> SampledPulse:
        """The pulse, and its sampling."""
        pulse = Pulse(PulseShape.TONE_BURST, self.carrier_hz, self.duration_s)
        return SampledPulse(pulse, Encoding.RAW, self.samples_per_cycle * self.carrier_hz)

    @property
    def channel(self) -> Channel:
        """Air above the floor."""
        return replace(CONCRETE, floor_reflectivity=self.reflectivity)

    @property
    def interferes_as_described(self) -> bool:
        """Whether the near and the far echo cancel themselves, but not the middle one."""
        ranges_m, _ = ALIGNED.polar(np.array(self.centres))
        return interfere_as_described(in_phase(self.channel, ranges_m, self.carrier_hz))


def range_of_the_caption() -> Part:
    """Share of settings in which each statement of figure 8's caption holds."""
    groups = {
        "about figure 8": list(_about_figure_8()),
        "at random, 0.5 to 50 kHz": list(_at_random()),
        "at random, interfering like figure 7": list(_at_random(as_described=True)),
    }
    shares = {name: shares_holding(settings) for name, settings in groups.items()}
    numbers: dict[str, Any] = {
        "offsets_in_wavelengths": list(OFFSETS),
        "wavelength_of_figure_8_m": AIR.sound_speed_m_s / SINE.carrier_hz,
        "settings": {name: len(settings) for name, settings in groups.items()},
        "shares": shares,
    }
    with styled():
        figure = new_figure(11.0, 4.2)
        panels = figure.subplots(1, len(groups), sharey=True)
        for axes, (name, share) in zip(panels, shares.items(), strict=True):
            for number, (words, values) in enumerate(share.items()):
                look = {"color": "black", "linewidth": 2.5} if words == ALL else {}
                color = ROBOTS[number % len(ROBOTS)]
                axes.plot(
                    OFFSETS,
                    values,
                    **({"color": color, "marker": "o", "markersize": 3} | look),
                    label=words,
                )
            axes.set_xscale("log")
            axes.set_xticks(OFFSETS, [f"{100 * offset:g}" for offset in OFFSETS])
            axes.minorticks_off()
            axes.set(
                xlabel="offset (% of a wavelength)",
                title=name[0].upper() + name[1:],
                ylim=(-0.03, 1.03),
            )
            axes.axhline(0.0, color=FAINT, linewidth=0.8)
        panels[0].set_ylabel("share of the settings")
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return Part("figure_8_range", numbers, figure)


def shares_holding(settings: list[Setting]) -> dict[str, list[float]]:
    """Share of settings in which each statement holds, by offset."""
    held: dict[str, FloatArray] = {}
    for number, setting in enumerate(settings):
        for column, one in enumerate(_judged(setting, np.random.default_rng([3, number]))):
            for words, holds in one.items():
                held.setdefault(words, np.zeros(len(OFFSETS)))[column] += holds
    return {words: (counts / len(settings)).tolist() for words, counts in held.items()}


def _judged(setting: Setting, generator: np.random.Generator) -> Iterator[dict[str, bool]]:
    """Judge the caption for objects farther and farther from the centres of their cells."""
    silent = hear([], setting.listening, channel=setting.channel)
    dictionaries = [
        CellDictionary.for_trace(silent, CELL_M, floor=floor, as_sparse=True)
        for floor in (False, True)
    ]
    angles = generator.uniform(0.0, 2.0 * np.pi, len(setting.centres))
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    wavelength_m = AIR.sound_speed_m_s / setting.carrier_hz
    for offset in OFFSETS:
        objects = np.array(setting.centres) + offset * wavelength_m * directions
        trace = hear(objects, setting.listening, channel=setting.channel)
        simple, multipath = (explain(one, trace, method()) for one in dictionaries)
        told = {words: one["holds"] for words, one in caption(simple, multipath, objects).items()}
        yield told | {ALL: all(told.values())}


def _about_figure_8() -> Iterator[Setting]:
    generator = np.random.default_rng(0)
    for _ in range(NEAR_SETTINGS):
        yield Setting(
            carrier_hz=generator.uniform(700.0, 800.0),
            duration_s=generator.uniform(4.5e-3, 5.5e-3),
            samples_per_cycle=generator.uniform(8.0, 20.0),
            reflectivity=generator.uniform(0.8, 1.0),
            centres=CENTRES,
        )


def _at_random(*, as_described: bool = False) -> Iterator[Setting]:
    """Draw settings; `as_described`: those with the interference that the paper tells of."""
    generator = np.random.default_rng(1)
    drawn = 0
    while drawn < RANDOM_SETTINGS:
        setting = Setting(
            carrier_hz=float(np.exp(generator.uniform(*np.log((0.5e3, 50e3))))),
            duration_s=generator.uniform(3e-3, 6e-3),
            samples_per_cycle=generator.uniform(5.0, 10.0),
            reflectivity=generator.uniform(0.7, 1.0),
            centres=[cells[int(generator.integers(len(cells)))] for cells in (NEAR, MIDDLE, FAR)],
        )
        if not as_described or setting.interferes_as_described:
            drawn += 1
            yield setting
