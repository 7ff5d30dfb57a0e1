"""The live nodes: a message in, one call into the core, a message out.

Only this package imports rclpy.
"""

from usmap_ros.nodes.program import begin_program
from usmap_ros.processes.cores import keep_linear_algebra_to_one_core

# First of all: what comes next takes seconds.
keep_linear_algebra_to_one_core()
begin_program()
