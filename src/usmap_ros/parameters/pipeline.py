"""Every parameter of reconstruction and mapping."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal

from pydantic import model_validator

from usmap_ros.parameters.fields import ParameterGroup, quantity
from usmap_ros.parameters.poses import PoseParameters
from usmap_ros.parameters.reception import (
    CorrectionParameters,
    Numbers,
    PulseParameters,
    RingingParameters,
)

#: Solvers of `usmap_ros.reconstruction.solvers`.
SolverName = Literal["cosamp", "omp", "l1", "tv", "walls", "nnls", "integer", "binary"]


class ReconstructionParameters(ParameterGroup):
    """How echoes are recovered from one trace."""

    dictionary: Literal["delay", "cells"] = quantity(
        "delay",
        "What echoes are looked for by: their delay, or, as in the paper, the grid cell at whose"
        " centre an object would return them.",
    )
    solver: SolverName = quantity(
        "cosamp",
        "How few echoes are found that explain a trace: CoSaMP, orthogonal matching pursuit, least"
        " l1 norm, least total variation, fewest walls, non-negative least squares, whole or"
        " binary coefficients. All but CoSaMP need the dictionary of cells.",
    )
    cell_size_m: float = quantity(
        0.05, "Side of a cell of the dictionary of cells.", "m", ge=0.005, le=2.0
    )
    upright_objects: bool = quantity(
        True,
        "Objects reach up to the transducer, and answer from its height; otherwise they all lie at"
        " object_height_m.",
    )
    object_height_m: float = quantity(
        0.0,
        "Height (z in the world frame) of objects that are not upright.",
        "m",
        ge=-1000.0,
        le=1000.0,
    )
    object_diameter_m: float = quantity(
        0.0,
        "Diameter of the objects that cells of the dictionary of cells are taken to hold, which"
        " answer from the nearest point of their surface; 0: points.",
        "m",
        ge=0.0,
        le=10.0,
    )
    full_reflectivity: float = quantity(
        1.0,
        "Reflectivity of an object that fills its cell: a coefficient of the dictionary of cells is"
        " the share of it, which is how far the cell is occupied.",
        gt=0.0,
        le=100.0,
    )
    known_walls: str = quantity(
        "",
        "File of known walls, as `usmap walls` writes it: columns of the dictionary of cells have"
        " the paths by way of them; none if empty.",
    )
    sparsity: int = quantity(
        32, "Most echoes that are looked for in one ping (k of CoSaMP).", ge=1, le=1000
    )
    non_negative: bool = quantity(
        True, "Fit real, not negative coefficients where the signal has no carrier phase."
    )
    false_alarms_per_ping: float = quantity(
        0.01, "Noise peaks taken for an echo, expected in one ping.", gt=0.0, lt=1.0
    )
    model_error: float = quantity(
        0.02,
        "Amplitude near an echo, relative to it, that may be due to an imperfect pulse model.",
        ge=0.0,
        lt=1.0,
    )
    oversampling: int = quantity(4, "Delays on the search grid per baseband sample.", ge=1, le=64)
    exclusion: float = quantity(
        0.35,
        "Least delay between two echoes, in pulse durations; a chirp counts as it is behind its"
        " matched filter, which is 4 / sweep.",
        gt=0.0,
        le=2.0,
    )
    chirp_sweep_hz: float = quantity(
        0.0,
        "How far a chirp's frequency rises, negative if it falls, where no TransducerArray message"
        " says it; 0: not known.",
        "Hz",
        ge=-1e7,
        le=1e7,
    )
    refinements: int = quantity(
        4, "Rounds of moving delays off the grid and searching again.", ge=0, le=50
    )
    masking: float = quantity(
        2.0,
        "Amplitude, relative to an echo, at which a second object under it would be noticed.",
        gt=0.0,
        le=100.0,
    )
    interference: float = quantity(
        1.0,
        "Uncertainty of an amplitude, relative to the echoes that overlap with it.",
        ge=0.0,
        le=10.0,
    )
    max_iterations: int = quantity(20, "CoSaMP iterations in one round.", ge=1, le=1000)
    limit_step_m: float = quantity(
        0.025, "Range bins in which the detection limit is reported.", "m", ge=0.001, le=1.0
    )
    valid_from_s: float = quantity(
        0.0,
        "When samples begin to be valid after the start of emission, since the transmitter has rung"
        " out; 0: found in every trace.",
        "s",
        ge=0.0,
        le=10.0,
    )
    valid_until_s: float = quantity(
        0.0,
        "When samples cease to be valid, since the receiver mutes itself; 0: found in every trace.",
        "s",
        ge=0.0,
        le=1000.0,
    )
    receiver_offset_m: Numbers = quantity(
        [0.0, 0.0, 0.0],
        "Where the receiving element of a sensor of two is, ahead, to the left and upwards of the"
        " one that sends, whose pose traces state.",
        "m",
        min_length=3,
        max_length=3,
    )
    correction: CorrectionParameters = CorrectionParameters()
    pulse: PulseParameters = PulseParameters()
    ringing: RingingParameters = RingingParameters()

    @model_validator(mode="after")
    def _solver_has_its_dictionary(self) -> ReconstructionParameters:
        if self.dictionary == "delay" and self.solver != "cosamp":
            raise ValueError(f"solver: {self.solver} needs the dictionary of cells")
        return self


class MappingParameters(ParameterGroup):
    """How cones become a map."""

    renamed: ClassVar[Mapping[str, str]] = {"audibility": "detection_probability"}
    #: Methods that have a use for a parameter, where others have none.
    used_by: ClassVar[Mapping[str, tuple[str, ...]]] = {
        **dict.fromkeys(
            (
                "occlusion",
                "opacity",
                "forgetting",
                "proof_rays",
                "wall_gap_m",
                "window",
                "weigh_robots",
                "correct_common_errors",
            ),
            ("joint",),
        ),
        "fluctuation": ("joint", "additive"),
        "detection_probability": ("joint", "additive"),
        "observed_exposure": ("additive", "range_only"),
    }

    method: Literal["joint", "additive", "range_only"] = quantity(
        "joint",
        "How pings become a map: all pings of the window explained together whenever a map is asked"
        " for, with walls and free space by how the place answers; or, to compare with, each echo's"
        " evidence added to every cell of its ring, or what nav2's model of range sensors makes of"
        " each first echo.",
    )
    resolution_m: float = quantity(0.05, "Side of a map cell.", "m", ge=0.005, le=2.0)
    most_cells: int = quantity(
        25_000_000,
        "Cells that the rectangle of a map may have, however few of them are known: 250 m x 250 m"
        " of 5 cm. Pings that would make it larger are set apart.",
        ge=1,
        le=4_000_000_000,
    )
    prior: float = quantity(
        0.005, "Probability that a cell of which nothing is known is occupied.", gt=0.0, lt=1.0
    )
    least_log_odds: float = quantity(-10.0, "Lower clamp of a cell's log-odds.", ge=-50.0, lt=0.0)
    greatest_log_odds: float = quantity(2.5, "Upper clamp of a cell's log-odds.", gt=0.0, le=50.0)
    reflectivity: float = quantity(
        0.5, "Median reflectivity expected of an object.", gt=0.0, le=10.0
    )
    reflectivity_spread: float = quantity(
        0.9, "Standard deviation of ln reflectivity from object to object.", gt=0.0, le=5.0
    )
    fluctuation: float = quantity(
        0.1, "Standard deviation of ln reflectivity from look to look.", gt=0.0, le=5.0
    )
    detection_probability: float = quantity(
        0.95, "Probability that a loud enough object in the clear is heard.", gt=0.0, lt=1.0
    )
    range_error_m: float = quantity(
        0.003, "Error of range that neither trace nor pose states.", "m", gt=0.0, le=1.0
    )
    occlusion: bool = quantity(True, "Let what the map believes hide what is behind it.")
    opacity: float = quantity(
        1.0,
        "Optical depth of a cell, over -ln(1 - p): how well what is believed in hides.",
        ge=0.0,
        le=10.0,
    )
    forgetting: float = quantity(
        0.08,
        "Share of what speaks for a cell that is forgotten with every ping that contradicts it.",
        ge=0.0,
        lt=1.0,
    )
    proof_rays: float = quantity(
        3.0,
        "Rays that are known to have passed through a cell, from which on it is free.",
        gt=0.0,
        le=1e3,
    )
    wall_gap_m: float = quantity(
        0.5,
        "Widest gap in a straight run of believed cells that counts as wall; 0: no runs are looked"
        " for.",
        "m",
        ge=0.0,
        le=2.0,
    )
    window: int = quantity(
        3000,
        "Recent pings that are explained together; what earlier ones said stays. Of pings from one"
        " place the newest few are kept.",
        ge=1,
        le=100_000,
    )
    weigh_robots: bool = quantity(
        True,
        "Let robots that the others, or they themselves, contradict count for less, and those that"
        " are named as faulty for nothing.",
    )
    correct_common_errors: bool = quantity(
        True,
        "Correct what is wrong with all pings alike, by how well echoes heard from several places"
        " meet: ranges that are too long or too short, since sound is slower or faster than was"
        " stated or traces begin late, and poses that are told late or early.",
    )
    observed_exposure: float = quantity(
        1.0,
        "Expected number of times that an object would have been heard, from which on a silent"
        " cell counts as observed.",
        gt=0.0,
        le=100.0,
    )

    @model_validator(mode="after")
    def _all_that_is_set_is_used(self) -> MappingParameters:
        for name, methods in self.used_by.items():
            is_set = getattr(self, name) != type(self).model_fields[name].default
            if is_set and self.method not in methods:
                raise ValueError(f"{name}: method {self.method} has no use for it")
        return self

    @property
    def shadow_opacity(self) -> float:
        """`opacity`, as far as anything hides what is behind it."""
        return self.opacity if self.occlusion else 0.0


class PipelineParameters(ParameterGroup):
    """Everything between an echo trace and a map."""

    reconstruction: ReconstructionParameters = ReconstructionParameters()
    mapping: MappingParameters = MappingParameters()
    poses: PoseParameters = PoseParameters()
