"""From an echo trace to the echoes in its cone: sensing matrices, CoSaMP, off-grid refinement."""
