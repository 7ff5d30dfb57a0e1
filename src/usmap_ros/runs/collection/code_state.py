"""What cones are made by: the code of reconstruction, and of all that it stands on."""

import hashlib
from functools import lru_cache
from pathlib import Path

#: Where the package is.
PACKAGE = Path(__file__).parents[2]
#: Files and rooms of the package of which cones depend on any line.
MAKERS = (
    *(
        "__init__.py",
        "bounds.py",
        "acoustics",
        "calibration",
        "io",
        "numerics",
        "parameters",
        "pings",
    ),
    *("reconstruction", "runs/offline.py", "runs/parallel.py", "runs/pipeline.py"),
)


@lru_cache(maxsize=4)
def reconstruction_state(package: Path) -> str:
    """Digest of the sources that turn traces into cones, which changes with any line of them.

    Parameters
    ----------
    package : path
        Folder of the package.
    """
    digest = hashlib.sha256()
    for maker in MAKERS:
        place = package / maker
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(f"{file.relative_to(package).as_posix()}\n".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()
