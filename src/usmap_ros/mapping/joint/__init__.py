"""Joint estimation: all pings of an area explained together, until nothing moves any more."""
