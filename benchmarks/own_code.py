"""What the package's own code gains where a library does the same.

Of `numerics.elementary` the time for one value in a compiled loop, beside that of the compiler's
own functions; of `io.cdr` the time to read a trace of 600 samples to a checked `EchoTrace`, beside
rosbags alone, which makes an unchecked message of it, and what rosbags needs once at the start;
where ROS is there, what rclpy needs to make its message of the same bytes.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial

import numpy as np

from usmap_ros.io.conversions import trace_from_cdr, trace_to_cdr
from usmap_ros.io.message_types import ECHO_TRACE, typestore
from usmap_ros.numerics.compiled import compiled
from usmap_ros.numerics.elementary import atan2_32, exp32, log32
from usmap_ros.simulation import hear

VALUES = 100_000
#: In a process of its own: what the types of messages take to be learnt.
LEARN = """
import time
from usmap_ros.io import message_types
begun_s = time.perf_counter()
message_types.typestore().deserialize_cdr(open(0, "rb").read(), message_types.ECHO_TRACE)
print(1e3 * (time.perf_counter() - begun_s))
"""


@compiled
def _exp32(x, y):
    for i in range(len(x)):
        y[i] = exp32(x[i])


@compiled
def _exp(x, y):
    for i in range(len(x)):
        y[i] = math.exp(x[i])


@compiled
def _log32(x, y):
    for i in range(len(x)):
        y[i] = log32(x[i])


@compiled
def _log(x, y):
    for i in range(len(x)):
        y[i] = math.log(x[i])


@compiled
def _atan2_32(x, y):
    for i in range(len(x)):
        y[i] = atan2_32(x[i], y[i])


@compiled
def _atan2(x, y):
    for i in range(len(x)):
        y[i] = math.atan2(x[i], y[i])


def run() -> dict[str, float]:
    """Measure."""
    x = np.random.default_rng(0).uniform(0.1, 5.0, VALUES).astype(np.float32)
    found = {}
    for function in (_exp32, _exp, _log32, _log, _atan2_32, _atan2):
        spent_s = least_s(partial(function, x, x[::-1].copy()), 20)
        found[f"{function.__name__.strip('_')}_ns"] = 1e9 * spent_s / VALUES
    payload = bytes(trace_to_cdr(hear([(1.5, 0.2)])))
    found["read_trace_us"] = 1e6 * least_s(lambda: trace_from_cdr(payload), 500)
    store = typestore()
    found["rosbags_read_us"] = 1e6 * least_s(
        lambda: store.deserialize_cdr(payload, ECHO_TRACE), 500
    )
    learnt = subprocess.run(
        [sys.executable, "-c", LEARN], input=payload, capture_output=True, check=True
    )
    found["rosbags_learn_ms"] = float(learnt.stdout)
    with suppress(ImportError):
        from rclpy.serialization import deserialize_message
        from usmap_msgs.msg import EchoTrace

        found["rclpy_read_us"] = 1e6 * least_s(lambda: deserialize_message(payload, EchoTrace), 500)
    return found


def least_s(call: Callable[[], object], turns: int) -> float:
    """Least time that a call takes."""
    call()
    spent_s = []
    for _ in range(turns):
        begun_s = time.perf_counter()
        call()
        spent_s.append(time.perf_counter() - begun_s)
    return min(spent_s)


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
