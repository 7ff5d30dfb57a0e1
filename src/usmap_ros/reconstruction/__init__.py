"""From an echo trace to the echoes in its cone: sensing operators, CoSaMP, off-grid refinement."""
