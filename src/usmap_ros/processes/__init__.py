"""Processes: how many cores they take, who ends them, and work that is given to others."""
