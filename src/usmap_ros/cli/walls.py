"""``usmap walls``: the straight walls of a map, for a next pass that knows them."""

from pathlib import Path
from typing import Annotated

import typer


def walls(
    map_path: Annotated[
        Path,
        typer.Argument(
            metavar="MAP", help="Folder that `usmap map` wrote, or the YAML file of any nav2 map."
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="WALLS.yaml", help="File for the walls.")
    ],
    least_length: Annotated[
        float, typer.Option(metavar="M", min=0.01, help="Least length of a wall in metres.")
    ] = 1.0,
    reflectivity: Annotated[
        float, typer.Option(min=0.001, max=1.0, help="Amplitude that they reflect as mirrors.")
    ] = 0.3,
) -> None:
    """Find the straight walls of a map, for --set reconstruction.known_walls=WALLS.yaml."""
    import numpy as np

    from usmap_ros.grids import OCCUPIED_PROBABILITY
    from usmap_ros.io.map_files import NAV2_FILE
    from usmap_ros.io.nav2_map import load_nav2_map
    from usmap_ros.io.wall_files import KnownWalls, WallSegment, save_walls
    from usmap_ros.mapping.straight_walls import straight_walls

    plan = load_nav2_map(map_path / NAV2_FILE if map_path.is_dir() else map_path)
    centers_m = plan.geometry.cell_centers_m(*np.nonzero(plan.probability >= OCCUPIED_PROBABILITY))
    found = straight_walls(centers_m, plan.geometry.resolution_m, least_length)
    segments = [
        WallSegment(start_m=tuple(start), end_m=tuple(end), reflectivity=reflectivity)
        for start, end in np.stack(found, axis=1).tolist()
    ]
    save_walls(output, KnownWalls(walls=segments))
    typer.echo(f"{output}: {len(segments)} walls of {least_length:g} m or more")
