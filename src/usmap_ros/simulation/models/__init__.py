"""The keys of a scenario file: each model is a section, and says what its keys mean."""
