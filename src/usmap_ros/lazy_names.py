"""Packages whose names are imported when they are asked for, not before."""

import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module


def offered(package: str, homes: Mapping[str, Sequence[str]]) -> Callable[[str], object]:
    """A package's `__getattr__`.

    Parameters
    ----------
    package : str
        The package's whole name, as ``__name__`` has it.
    homes : mapping
        Names that it offers, by the module below it in which they are at home.
    """
    modules = {name: module for module, names in homes.items() for name in names}

    def get(name: str) -> object:
        """Import what is asked for, the first time it is."""
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value: object = getattr(import_module(f"{package}.{modules[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    return get
