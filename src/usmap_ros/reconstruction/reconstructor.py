"""The front door of reconstruction: from an echo trace to its cone, by whatever method is set.

Pipeline, worker processes, nodes and pictures all come in here, so that a setting which is
accepted is obeyed by all of them.
"""

from collections.abc import Sequence

import numpy as np

from usmap_ros.errors import MalformedMessageError
from usmap_ros.parameters import ReconstructionParameters
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.preparation.prepare import prepared
from usmap_ros.pings.preparation.ring_down import without_ringing
from usmap_ros.pings.trace import EchoTrace, Encoding
from usmap_ros.reconstruction.array_bearings import Reconstructed, cone_with_bearings, is_spent
from usmap_ros.reconstruction.delays import DelayReconstruction, reconstruct_delays
from usmap_ros.reconstruction.explained import Reconstruction


def reconstruct(trace: EchoTrace, parameters: ReconstructionParameters) -> Reconstruction:
    """Explain `trace` by few echoes, with the dictionary and the solver that are set.

    Parameters
    ----------
    trace : EchoTrace
        A valid trace.
    parameters : ReconstructionParameters
        What is off in the trace; dictionary, solver, and what they go by.

    Raises
    ------
    MalformedMessageError
        If the trace cannot be reconstructed.
    """
    known = prepared(trace, parameters)
    if parameters.dictionary == "cells":
        return _by_cells(known, parameters)
    found = reconstruct_delays(known, parameters)
    cone = without_ringing(cone_with_bearings(0, [(known, found)]), parameters.ringing)
    return _by_delays(known, found, cone)


def reconstruct_sounding(
    traces: Sequence[EchoTrace], parameters: ReconstructionParameters
) -> list[Reconstruction | MalformedMessageError | None]:
    """Explain the traces of transducers that pinged at once, each by itself and all together.

    By delays, the echoes of one transducer get the bearings that the others tell.

    Parameters
    ----------
    traces : sequence of EchoTrace
        Of one stamp and array of transducers; or a single one.
    parameters : ReconstructionParameters
        Dictionary, solver, and what they go by.

    Returns
    -------
    list of Reconstruction, MalformedMessageError or None
        For each trace: what was found, why it could not be reconstructed, or None where all that
        a transducer has heard is in the bearings of others.
    """
    outcomes: list[Reconstruction | MalformedMessageError | None] = []
    heard: dict[int, Reconstructed] = {}
    for place, trace in enumerate(traces):
        try:
            known = prepared(trace, parameters)
            if parameters.dictionary == "cells":
                outcomes.append(_by_cells(known, parameters))
            else:
                heard[place] = (known, reconstruct_delays(known, parameters))
                outcomes.append(None)
        except MalformedMessageError as error:
            outcomes.append(error)
    together = list(heard.values())
    for number, place in enumerate(heard):
        if not is_spent(number, together):
            cone = without_ringing(cone_with_bearings(number, together), parameters.ringing)
            outcomes[place] = _by_delays(*together[number], cone)
    return outcomes


def _by_delays(trace: EchoTrace, found: DelayReconstruction, cone: EchoCone) -> Reconstruction:
    baseband = found.baseband
    template = baseband.template
    # A filter makes an echo longer on either side of its peak.
    longer_s = template.duration_s - template.pulse.length_s
    peak_s = template.start_s + template.pulse.peak_s + 0.5 * longer_s
    return Reconstruction(
        trace,
        cone,
        baseband.signal,
        found.residual,
        baseband.sampling,
        peak_s,
        baseband.noise_std,
    )


def _by_cells(trace: EchoTrace, parameters: ReconstructionParameters) -> Reconstruction:
    # Its solvers take longer to import than a short recording takes to map.
    from usmap_ros.reconstruction.cells import cell_cone, reconstruct_cells

    found = reconstruct_cells(trace, parameters)
    received, residual, noise_std = found.signal, found.residual, found.noise_std
    if trace.encoding is Encoding.IQ:
        # The dictionary has I and Q interleaved, as the trace has them.
        received, residual = received.view(np.complex128), residual.view(np.complex128)
        noise_std *= np.sqrt(2.0)
    return Reconstruction(
        trace,
        without_ringing(cell_cone(trace, found, parameters), parameters.ringing),
        received,
        residual,
        trace.sampling,
        trace.transducer.pulse.peak_s,
        noise_std,
    )
