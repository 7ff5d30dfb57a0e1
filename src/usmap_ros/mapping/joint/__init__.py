"""Joint estimation: all pings of an area explained together, until nothing moves any more.

What pings see of cells (`visibility`), which powers of cells explain what they heard
(`forward_model`), what stands (`surfaces`), and what silence says of the rest (`free_space`) follow
each other; the modules beside them ask for all of it in turn.
"""
