"""The live nodes: a message in, one call into the core, a message out.

Only this package imports rclpy.
"""
