"""From recordings or scenarios to maps: the pipeline, and programs that run it to the end."""
