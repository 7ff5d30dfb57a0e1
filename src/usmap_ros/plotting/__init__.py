"""Pictures of traces, cones and maps."""
