"""Bags, map files and YAML files."""
