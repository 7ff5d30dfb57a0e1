"""How certain cells are, by what pings say of them."""

import numpy as np

from usmap_ros.mapping.joint.forward_model.cell_evidence import CellEvidence
from usmap_ros.mapping.joint.forward_model.log_odds import cell_log_odds


def test_who_explains_few_of_the_echoes_that_may_be_its_is_less_certain() -> None:
    """Two cells that as much speaks for; the second one would have explained more."""
    evidence = CellEvidence(*(np.zeros(5, np.float32) for _ in CellEvidence._fields))
    own = [0, 3]
    evidence.own[own] = evidence.block[own] = 5.0
    evidence.heard[own], evidence.axis_cos[own] = 4.0, 3.0
    evidence.asked[own] = 4.0, 20.0
    wholly, hardly = cell_log_odds(evidence, (1, 5))[0, own]
    assert wholly > hardly + 0.5
