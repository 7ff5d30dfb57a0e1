"""What the tests of the live side without ROS share."""

import pytest


class FakeClock:
    """A clock that goes on only when it is told to."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s

    def pass_time(self, seconds: float) -> None:
        self.now_s += seconds


@pytest.fixture
def clock() -> FakeClock:
    """Give a clock that stands still by itself."""
    return FakeClock()
