"""Traces and cones set right before anything is read from them."""
