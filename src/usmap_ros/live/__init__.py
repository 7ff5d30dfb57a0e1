"""What the live nodes do that needs no ROS: order, fuse and keep cones, and run processes.

`interfaces` declares every topic and service; `usmap_ros.nodes` puts all of it on them.
"""
