"""The live nodes: a message in, one call into the core, a message out.

Only this package imports rclpy.
"""

import os

from usmap_ros.nodes.program import begin_program

# First of all: what comes next takes seconds.
begin_program()

# Before NumPy is imported: the matrices are small, and the threads of the linear algebra of many
# nodes would only wait for each other.
for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")
