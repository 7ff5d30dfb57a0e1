"""CoSaMP on echoes that each touch a few samples only, compiled.

No column is ever built in full: the matched filter, the Gram matrix and the residual take part
only in the samples that an echo falls on.
"""
