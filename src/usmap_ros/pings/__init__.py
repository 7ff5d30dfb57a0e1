"""What one ping is: its trace, the cone made of it, from where, and which belong together."""
