"""Cones whose pose is in another frame than the map's."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from usmap_ros.errors import MalformedMessageError
from usmap_ros.live.health import Health
from usmap_ros.nodes.plumbing.frames import NoTransformError, Transforms
from usmap_ros.pings.cone import EchoCone


class ForeignCones:
    """Moves cones into the map's frame as soon as their transforms are known, or refuses them.

    Parameters
    ----------
    transforms : Transforms
        TF, if there is any.
    health : Health
        Counts what is refused.
    on_cone : callable
        Gets topic and cone of what could be moved.
    on_stranger : callable
        Gets topic and cone of what could not; whether it has a use for it.
    """

    def __init__(
        self,
        transforms: Transforms,
        health: Health,
        on_cone: Callable[[str, EchoCone], None],
        on_stranger: Callable[[str, EchoCone], bool],
    ) -> None:
        self._transforms = transforms
        self._health = health
        self._on_cone, self._on_stranger = on_cone, on_stranger
        self._waiting: deque[tuple[float, str, EchoCone]] = deque()

    def __len__(self) -> int:
        """Count those that wait."""
        return len(self._waiting)

    def add(self, topic: str, cone: EchoCone, frame_id: str, wait_s: float) -> None:
        """Move a cone into the frame `frame_id`, within `wait_s`."""
        self._waiting.append((time.monotonic() + wait_s, topic, cone))
        self.retry(frame_id)

    def retry(self, frame_id: str) -> None:
        """Move those whose transforms have come by now; refuse those that waited too long."""
        for _ in range(len(self._waiting)):
            deadline_s, topic, cone = self._waiting.popleft()
            try:
                moved = self._transforms.moved(cone, frame_id)
            except (NoTransformError, MalformedMessageError) as error:
                if self._transforms.is_available and time.monotonic() < deadline_s:
                    self._waiting.append((deadline_s, topic, cone))
                    continue
                if self._on_stranger(topic, cone):
                    continue
                self._health.problem(
                    "refused",
                    f"{topic}: its frame is '{cone.frame_id}', the map's is '{frame_id}',"
                    f" and {error}",
                )
            else:
                self._on_cone(topic, moved)
