"""Messages that are taken beside the executor."""

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from usmap_ros.io.cdr import CdrReader
from usmap_ros.live.interfaces import Qos, Topic
from usmap_ros.nodes.plumbing import wait_set_inbox
from usmap_ros.nodes.plumbing.inbox import Inbox
from usmap_ros.nodes.plumbing.open_inbox import open_inbox
from usmap_ros.nodes.plumbing.wait_set_inbox import WaitSetInbox

STRING = "std_msgs/msg/String"
TOPIC = Topic("said", STRING, Qos(depth=100), "Words.")


class Listener(Node):
    """Has an inbox for some topics, and nothing else."""

    def __init__(self, kind: Callable[..., Inbox] = open_inbox, **options: Any) -> None:
        super().__init__("listener", **options)
        self.heard: list[tuple[str, str]] = []
        self.threads: set[str] = set()
        self.inbox = kind(self)

    def listen(self, name: str) -> None:
        self.inbox.add(TOPIC, lambda payload: self.hear(name, payload), name)

    def hear(self, name: str, payload: bytes) -> None:
        word = CdrReader(payload).text()
        assert word != "nonsense"
        self.heard.append((name, word))
        self.threads.add(threading.current_thread().name)

    def close(self) -> None:
        self.inbox.close()


@pytest.fixture(params=[WaitSetInbox, Inbox])
def kind(request: pytest.FixtureRequest) -> type[Inbox]:
    """Give the inbox that is used, and the one for an rclpy that lacks what that needs."""
    return request.param  # type: ignore[no-any-return]


@pytest.fixture
def listener(live: Any, kind: type[Inbox]) -> Listener:
    node: Listener = live.add(partial(Listener, kind))
    return node


def test_every_message_comes_in_order_in_a_thread_of_its_own(live: Any, listener: Any) -> None:
    listener.listen("/one")
    listener.listen("/two")
    publishers = {name: live.publisher(STRING, name, 100) for name in ("/one", "/two")}
    said = {name: [str(number) for number in range(50)] for name in publishers}
    for number in range(50):
        for name, publisher in publishers.items():
            publisher.publish(_string(said[name][number]))
    live.until(lambda: len(listener.heard) == 100)
    for name in publishers:
        assert [word for topic, word in listener.heard if topic == name] == said[name]
    assert listener.threads == {"listener"}


def test_topics_come_and_go_while_it_waits(live: Any, listener: Any) -> None:
    listener.listen("/one")
    first = live.publisher(STRING, "/one", 100)
    listener.inbox.remove("/one")
    assert listener.inbox.topics == set()
    live.until(lambda: first.get_subscription_count() == 0)
    first.publish(_string("to nobody"))
    listener.listen("/two")
    live.publisher(STRING, "/two", 100).publish(_string("to somebody"))
    live.until(lambda: listener.heard)
    assert listener.heard == [("/two", "to somebody")]


def test_an_error_in_a_callback_ends_the_node(live: Any, listener: Any) -> None:
    listener.listen("/one")
    live.publisher(STRING, "/one", 100).publish(_string("nonsense"))
    with pytest.raises(AssertionError, match="nonsense"):
        live.until(lambda: False)


def test_who_publishes_what_cannot_be_heard_is_told_of(
    live: Any, listener: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    listener.listen("/one")
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    live.peer.create_publisher(type(_string("")), "/one", qos)
    said: list[str] = []

    def is_told() -> bool:
        said.append(capfd.readouterr().err)
        return "incompatible QoS" in "".join(said)

    live.until(is_told)
    assert "/one" in "".join(said)


def test_it_is_asked_again_after_the_time_that_it_gave(live: Any, kind: type[Inbox]) -> None:
    node = live.add(Listener)
    asked: list[int] = []

    def after() -> float | None:
        asked.append(1)
        return 0.001 if len(asked) < 5 else None

    inbox = kind(node, after)
    try:
        inbox.add(TOPIC, node.heard.append, "/one")
        live.until(lambda: len(asked) >= 5)
    finally:
        inbox.close()


@pytest.mark.parametrize("missing", ["WaitSet", "Subscription"])
def test_an_rclpy_that_lacks_wait_sets_does_all_the_same(
    live: Any, missing: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    assert isinstance(live.add(Listener).inbox, WaitSetInbox)
    private = rclpy_implementation

    class Other:
        def __getattr__(self, name: str) -> object:
            if name == missing:
                raise AttributeError(f"no {name}")
            return getattr(private, name)

    monkeypatch.setattr(wait_set_inbox, "rclpy_implementation", Other())
    listener = live.add(Listener)
    assert type(listener.inbox) is Inbox
    assert f"costs more of the processor: no {missing}" in capfd.readouterr().err
    listener.listen("/one")
    live.publisher(STRING, "/one", 100).publish(_string("hello"))
    live.until(lambda: listener.heard)
    assert listener.heard == [("/one", "hello")]


def _string(data: str) -> Any:
    from std_msgs.msg import String

    return String(data=data)
