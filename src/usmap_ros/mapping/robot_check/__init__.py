"""Which robots of several must not be believed, and how it shows."""
