"""What the nodes share, and what connects them to ROS: endpoints, parameters, TF, diagnostics."""
