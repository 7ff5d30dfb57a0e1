"""Scenes, robots on their paths, and the echo simulator."""
