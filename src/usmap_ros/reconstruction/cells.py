"""From an echo trace to coefficients of grid cells: the method of the paper, whole.

Sanchez & Andersson, "Using compressive sensing with in-air ultrasonic measurements for robotic
mapping", DSCC 2018-9140, sections 2 to 4.
"""

from dataclasses import dataclass

import numpy as np

from usmap_ros.io.wall_files import load_walls
from usmap_ros.numerics.arrays import FloatArray, IndexArray, Signal
from usmap_ros.numerics.special import normal_quantile
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.reconstruction.cell_dictionary import CellDictionary, CellObjects, cell_signal
from usmap_ros.reconstruction.column_sets import ColumnSets, alike, distinguishable
from usmap_ros.reconstruction.cones import RecoveredEchoes, make_cone
from usmap_ros.reconstruction.cosamp import Solution
from usmap_ros.reconstruction.detection import binned_maximum
from usmap_ros.reconstruction.matrix_operator import MatrixOperator
from usmap_ros.reconstruction.problem import Problem
from usmap_ros.reconstruction.pulses import check_pulses
from usmap_ros.reconstruction.solvers import solve

#: Solvers that need no more of Φ than the samples that an echo touches.
AS_SPARSE = ("cosamp", "omp", "l1", "tv", "walls")
#: Share of a signal that its samples' single precision may amount to.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class CellReconstruction:
    """A trace explained by the cells of a grid."""

    #: Φ and its cells.
    dictionary: CellDictionary
    #: (cells,) integer array: cells with the same number have parallel columns: no trace tells them
    #: apart.
    sets: IndexArray
    #: (cells,) array: q.  Cells with parallel columns share what their set was given, equal columns
    #: equally; whole numbers are in single cells (see `usmap_ros.reconstruction.column_sets`).
    coefficients: FloatArray
    #: (samples,) arrays: y and r_err = y − A q (section 4).
    signal: Signal
    residual: Signal
    #: What the solver returned, in terms of the columns that it was given.
    solution: Solution
    #: Standard deviation of the noise of `signal`; of the residual where it is not stated.
    noise_std: float

    @property
    def relative_residual(self) -> float:
        """‖y − Φ q‖ / ‖y‖; 0 for a silent trace."""
        total = float(np.linalg.norm(self.signal))
        return float(np.linalg.norm(self.residual)) / total if total > 0.0 else 0.0


def reconstruct_cells(
    trace: EchoTrace, parameters: ReconstructionParameters, *, floor: bool = True
) -> CellReconstruction:
    """Explain `trace` by objects at the centres of grid cells.

    Parameters
    ----------
    trace : EchoTrace
        A valid trace.
    parameters : ReconstructionParameters
        Cell size, sparsity, solver.  There are never more than `sparsity` cells, mirror images
        counted, that have a coefficient.
    floor : bool
        False: the paper's simple Φ, which knows nothing of the floor.

    Raises
    ------
    MalformedMessageError
        If the trace is sampled too slowly for its pulse, or the pulse is not known.
    """
    check_pulses(trace)
    dictionary = CellDictionary.for_trace(
        trace,
        parameters.cell_size_m,
        floor=floor,
        objects=CellObjects(
            parameters.object_diameter_m,
            parameters.full_reflectivity,
            load_walls(parameters.known_walls),
        ),
        as_sparse=parameters.solver in AS_SPARSE,
    )
    return explain(dictionary, trace, parameters)


def explain(
    dictionary: CellDictionary, trace: EchoTrace, parameters: ReconstructionParameters
) -> CellReconstruction:
    """`reconstruct_cells` with a dictionary that is at hand."""
    signal, noise_std = cell_signal(trace)
    labels = alike(dictionary)
    sets = distinguishable(dictionary, labels, parameters.solver)
    problem = Problem(
        operator=sets.operator,
        signal=signal,
        sparsity=parameters.sparsity,
        tolerance=noise_std * float(np.sqrt(len(signal))),
        threshold=max(
            _threshold(sets.operator, noise_std, parameters.false_alarms_per_ping),
            _ROUNDING * float(np.linalg.norm(signal)),
        ),
        non_negative=parameters.non_negative,
        places=dictionary.cells.places[sets.first],
        cells=sets.sizes,
        max_iterations=parameters.max_iterations,
    )
    solution = _few_cells(solve(problem, parameters.solver), problem, sets)
    rms = float(np.sqrt(np.mean(solution.residual**2)))
    return CellReconstruction(
        dictionary,
        labels,
        sets.by_cell(solution),
        signal,
        solution.residual,
        solution,
        noise_std or rms,
    )


def cell_cone(
    trace: EchoTrace, found: CellReconstruction, parameters: ReconstructionParameters
) -> EchoCone:
    """What fusion is told of a reconstruction by cells: an echo for each set of cells."""
    dictionary = found.dictionary
    support = np.unique(found.sets[found.coefficients != 0.0])
    _, first = np.unique(found.sets, return_index=True)
    cell = first[support]
    ranges_m = dictionary.cells.ranges_m[cell]
    unit = dictionary.unit_amplitudes
    by_set = np.bincount(found.sets, found.coefficients * unit, len(first))
    amplitudes = by_set[support].astype(float)
    stds = found.noise_std * unit[cell] / dictionary.norms[cell]
    return make_cone(
        trace,
        RecoveredEchoes(
            ranges_m=ranges_m,
            range_stds_m=np.full(len(support), parameters.cell_size_m / np.sqrt(12.0)),
            amplitudes=amplitudes,
            amplitude_stds=stds,
        ),
        _limits(trace, found, ranges_m, amplitudes, parameters),
        parameters.limit_step_m,
        residual=found.relative_residual,
    )


def _limits(
    trace: EchoTrace,
    found: CellReconstruction,
    echo_ranges_m: FloatArray,
    echo_amplitudes: FloatArray,
    parameters: ReconstructionParameters,
) -> FloatArray:
    """Amplitude below which an object could have gone unreported, by range bin.

    Between the ranges of cells nothing is looked for; there it is that of the cells around.
    """
    dictionary = found.dictionary
    ranges_m, unit = dictionary.cells.ranges_m, dictionary.unit_amplitudes
    heard = dictionary.norms > 0.0
    score = np.maximum(
        _threshold(dictionary, found.noise_std, parameters.false_alarms_per_ping),
        dictionary.scores(dictionary.adjoint(found.residual)),
    )
    limits = score[heard] * unit[heard] / dictionary.norms[heard]
    reach_m = 0.5 * trace.channel.sound_speed_m_s * trace.transducer.pulse.resolution_s
    for range_m, amplitude in zip(echo_ranges_m, echo_amplitudes, strict=True):
        masked = np.abs(ranges_m[heard] - range_m) < reach_m
        limits[masked] = np.maximum(limits[masked], parameters.masking * amplitude)
    start_m, stop_m = trace.transducer.min_range_m, trace.transducer.max_range_m
    step_m = parameters.limit_step_m
    bins_m = np.arange(start_m, stop_m, step_m)
    between = np.interp(bins_m, ranges_m[heard], limits) if heard.any() else np.inf * bins_m
    every_m = np.concatenate([bins_m, ranges_m[heard]])
    return binned_maximum(np.concatenate([between, limits]), every_m, start_m, step_m, stop_m)


def _threshold(operator: MatrixOperator, noise_std: float, false_alarms: float) -> float:
    """Score that normal noise alone exceeds in any column `false_alarms` times a ping."""
    return -noise_std * normal_quantile(false_alarms / max(operator.block_count, 1))


def _few_cells(solution: Solution, problem: Problem, sets: ColumnSets) -> Solution:
    """Keep the strongest sets that together have no more than `sparsity` cells, and fit again.

    Where a set of several cells no longer fits, a weaker one of fewer may: all that is allowed
    is spent.
    """
    cells = sets.cells_of(solution)
    strengths = problem.operator.echo_scores(solution.support, solution.coefficients)
    kept, left = [], problem.sparsity
    for block in np.argsort(-strengths, kind="stable"):
        if cells[block] <= left:
            kept.append(block)
            left -= cells[block]
    if len(kept) == len(cells):
        return solution
    support = solution.support[np.sort(kept)]
    return problem.fitted(support, solution.iterations, solution.halt)
