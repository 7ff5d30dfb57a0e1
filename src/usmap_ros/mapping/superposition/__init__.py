"""Fusion that explains every ping by the powers of all that stands in its cone."""
