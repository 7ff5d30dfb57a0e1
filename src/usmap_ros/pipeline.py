"""The product in one object: echo traces in, a map out."""
