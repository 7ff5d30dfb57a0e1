"""Animation of a map that forms, ping by ping."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from PIL import Image

from usmap_ros.errors import FileError, file_errors
from usmap_ros.grids import GridGeometry, OccupancyMap, TruthMap
from usmap_ros.io.atomic import write_atomically
from usmap_ros.numerics.arrays import FloatArray
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.robot_paths import RobotPaths
from usmap_ros.plotting import style
from usmap_ros.plotting.map import draw_legend, figure_size_in, robot_name
from usmap_ros.plotting.plan import draw_probability, draw_truth
from usmap_ros.plotting.shown import Extent, MapFrame, shown_extent

_FRAME_MS = 270
#: The finished map stays in view for a while.
_LAST_FRAME_MS = 3000
_DOTS_PER_INCH = 110
_COLORS = 128


def save_animation(
    frames: Sequence[MapFrame],
    paths: RobotPaths,
    path: Path,
    truth: TruthMap | None = None,
    extent_m: Extent | None = None,
) -> None:
    """Write snapshots of a map as an animated GIF.

    Parameters
    ----------
    frames : sequence of MapFrame
        In the order of time; the last one is the finished map.
    paths : RobotPaths
        The robots' whole paths.
    path : path
        The GIF; one that is there is replaced.
    truth : TruthMap, optional
        Drawn as an outline.
    extent_m : (x_min, x_max, y_min, y_max), optional
        What is shown; by default what the finished map observed and all paths.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    with style.styled():
        canvas = _MovingMap([frame.occupancy for frame in frames], paths, truth, extent_m)
        images = [canvas.draw(frame, frames[0].stamp_ns) for frame in frames]
    palette = _common_palette(images)
    indexed = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    durations = [_FRAME_MS] * (len(indexed) - 1) + [_LAST_FRAME_MS]
    content = BytesIO()
    indexed[0].save(
        content, format="GIF", save_all=True, append_images=indexed[1:], duration=durations, loop=0
    )
    with file_errors(FileError, path):
        write_atomically(path, content.getvalue())


def _common_palette(images: list[Image.Image]) -> Image.Image:
    """Choose colours for all frames at once: with a palette for each, they would flicker."""
    samples = [images[0], images[len(images) // 2], images[-1]]
    mosaic = Image.new("RGB", (samples[0].width, samples[0].height * len(samples)))
    for number, sample in enumerate(samples):
        mosaic.paste(sample, (0, number * sample.height))
    return mosaic.quantize(_COLORS)


class _MovingMap:
    """A figure of which each frame changes what differs, since making one takes long."""

    def __init__(
        self,
        maps: Sequence[OccupancyMap],
        paths: RobotPaths,
        truth: TruthMap | None,
        extent_m: Extent | None,
    ) -> None:
        # A map may shrink as it forms.
        self._geometry = GridGeometry.around([occupancy.geometry for occupancy in maps])
        self._paths = paths
        shown = extent_m or shown_extent(maps[-1:], paths)
        self._figure = style.new_figure(*figure_size_in(shown), _DOTS_PER_INCH)
        # Any: matplotlib leaves what Agg alone can do without types.
        self._canvas: Any = FigureCanvasAgg(self._figure)
        self._axes = self._figure.subplots()
        self._image = draw_probability(self._axes, maps[-1])
        self._image.set_extent(self._geometry.extent_m)
        self._figure.colorbar(
            self._image, ax=self._axes, shrink=0.6, label="probability of being occupied"
        )
        self._axes.set_xlim(*shown[:2])
        self._axes.set_ylim(*shown[2:])
        if truth is not None:
            draw_truth(self._axes, truth)
        self._title = self._axes.set_title("Map")
        topics = sorted(paths.positions_m)
        self._trails = {topic: self._trail(number, topic) for number, topic in enumerate(topics)}
        self._beams = {topic: self._beam(number) for number, topic in enumerate(topics)}
        draw_legend(self._figure, self._axes)
        # The layout is that of the first drawing: to find it again takes longer than to draw.
        self._figure.canvas.draw()
        self._figure.set_layout_engine("none")
        # All but the map stays as it is, and is drawn once.
        self._around = _drawn_without(self._axes, self._canvas)

    def draw(self, frame: MapFrame, start_ns: int) -> Image.Image:
        """Draw a frame; `start_ns` is the time of the first one."""
        self._image.set_data(_on_grid(frame.occupancy, self._geometry))
        self._title.set_text(f"Map after {(frame.stamp_ns - start_ns) / 1e9:.1f} s")
        for topic, cone in frame.cones.items():
            behind = self._paths.positions_m[topic][: frame.positions[topic]]
            self._trails[topic].set_data(*np.transpose(behind))
            self._beams[topic].set_xy(_cone_outline(cone))
        self._canvas.restore_region(self._around)
        self._figure.draw_artist(self._axes)
        # Taking the pixels from the canvas spares the detour over a compressed picture.
        return Image.fromarray(np.asarray(self._canvas.buffer_rgba())[..., :3])

    def _trail(self, number: int, topic: str) -> Line2D:
        color, name = style.robot_color(number), robot_name(topic)
        return self._axes.plot([], [], color=color, linewidth=1.3, alpha=0.85, label=name)[0]

    def _beam(self, number: int) -> Polygon:
        color = style.robot_color(number)
        face = to_rgba(color, 0.35)
        beam = Polygon(np.zeros((1, 2)), facecolor=face, edgecolor=color, linewidth=1.0)
        self._axes.add_patch(beam)
        return beam


def _drawn_without(axes: Axes, canvas: Any) -> Any:
    """A canvas with all that is on it but some axes, for its `restore_region`."""
    axes.set_visible(False)
    canvas.draw()
    axes.set_visible(True)
    return canvas.copy_from_bbox(canvas.figure.bbox)


def _cone_outline(cone: EchoCone) -> FloatArray:
    """Corners of the near part of a cone, (n, 2)."""
    half, yaw = cone.transducer.beam.half_angle_rad, cone.pose.yaw_rad
    reach_m = min(cone.transducer.max_range_m, 1.0)
    angles = yaw + np.linspace(-half, half, 17)
    arc = reach_m * np.column_stack([np.cos(angles), np.sin(angles)])
    return np.concatenate([np.zeros((1, 2)), arc]) + cone.pose.position_m[:2]


def _on_grid(occupancy: OccupancyMap, geometry: GridGeometry) -> FloatArray:
    """Probability on a larger grid with the same cells; NaN where nothing was observed."""
    probability = np.full(geometry.shape, np.nan)
    probability[occupancy.geometry.within(geometry)] = np.where(
        occupancy.observed, occupancy.probability(), np.nan
    )
    return probability
