"""Walls, columns and lines that go through what was heard."""
