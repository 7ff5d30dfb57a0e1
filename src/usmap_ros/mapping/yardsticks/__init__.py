"""Plain ways of fusion that the default is held to."""
