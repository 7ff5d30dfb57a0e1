"""Multi-robot occupancy mapping from in-air ultrasound.

Data flows one way: acoustics → simulation → reconstruction → mapping.
``io`` stands beside them; ``nodes`` and ``cli`` are thin and on top.
"""

__version__ = "0.1.0"
