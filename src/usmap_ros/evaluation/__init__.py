"""How good a map is, by a truth that is laid over it."""
