"""Node that recovers the echoes in each trace."""

import time
import traceback
from collections import deque
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node

from usmap_ros.calibration.receiver_survey import Judgement, Judging, ReceiverSurvey
from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.conversions import (
    array_from_cdr,
    cone_to_cdr,
    points_to_message,
    scan_to_message,
    trace_from_cdr,
)
from usmap_ros.live.attendance import LISTENERS
from usmap_ros.live.health import Level, Remark
from usmap_ros.live.interfaces import (
    CONE,
    CONE_CELLS,
    CONE_RECONSTRUCTOR,
    ECHO,
    FREE_SCAN,
    READING,
    TRANSDUCERS,
)
from usmap_ros.mapping.candidates import candidate_cells
from usmap_ros.mapping.free_scan import free_scan
from usmap_ros.nodes.plumbing.diagnostics import NodeHealth
from usmap_ros.nodes.plumbing.endpoints import advertise, subscribe, within
from usmap_ros.nodes.plumbing.open_inbox import open_inbox
from usmap_ros.nodes.plumbing.parameter_server import ParameterServer
from usmap_ros.nodes.plumbing.pose_sources import NoPoseError
from usmap_ros.nodes.plumbing.range_input import RangeInput
from usmap_ros.nodes.plumbing.ros_types import RosMessageTypes
from usmap_ros.nodes.plumbing.run import run_node
from usmap_ros.nodes.plumbing.worker import Worker
from usmap_ros.parameters import MappingParameters, PipelineParameters
from usmap_ros.parameters.nodes import ConeReconstructorParameters
from usmap_ros.pings.amplitude_scale import AmplitudeScale
from usmap_ros.pings.cone import EchoCone
from usmap_ros.pings.soundings import SoundingCollector, TransducerArrays
from usmap_ros.pings.trace import EchoTrace
from usmap_ros.processes.workers import Beside
from usmap_ros.runs.pipeline import Pipeline

#: How often a receiver is judged: once its pulse can be told, once its robot has moved, and once it
#: has turned.
_JUDGEMENTS = 3
#: How often it is looked whether one has been, while no traces come.
_LOOK_S = 0.1


@dataclass(frozen=True)
class _Outputs:
    """Where the cones of one transducer go."""

    topic: str
    cone: Any
    cells: Any
    scan: Any
    scale: AmplitudeScale


@dataclass(frozen=True)
class _Job:
    """A trace that waits."""

    outputs: _Outputs
    payload: bytes
    received_s: float


class ConeReconstructor(Node):
    """From ``echo`` to ``cone``: traces wait in a bounded queue for a thread that works on them.

    Keyword arguments are those of `rclpy.node.Node`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(
            CONE_RECONSTRUCTOR.name, automatically_declare_parameters_from_overrides=True, **options
        )
        self.parameters = ParameterServer(self, ConeReconstructorParameters)
        self.parameters.on_change.append(self._renew_pipeline)
        self._renew_pipeline()
        self.health = NodeHealth(
            self,
            self.parameters.value.diagnostics_period_s,
            (
                "received",
                "published",
                "unheard",
                "malformed",
                "implausible",
                "without pose",
                "dropped",
                "failed",
            ),
        )
        self.health.watch(lambda: self.health.silence("no trace has come on echo"))
        self.health.watch(lambda: self.health.slowness(self.parameters.value.latency_limit_s))
        self.health.watch(self._look_at_receivers)
        self._types = RosMessageTypes()
        self._arrays = TransducerArrays()
        self._collector: SoundingCollector[_Job] = SoundingCollector()
        subscribe(self, TRANSDUCERS, self._learn, raw=True)
        self._queue: deque[_Job] = deque()
        self._worker = Worker(self, self._step)
        # Once for all traces that came together.
        self._inbox = open_inbox(self, after=self._worker.wake)
        parameters = self.parameters.value
        self._ranges = RangeInput(self, self.health, parameters) if self._has_ranges else None
        names = self.parameters.value.transducers or [""]
        self._outputs = [self._connect(transducer) for transducer in names]
        self.health.tell(LISTENERS, self._fewest_listeners)

    def close(self) -> None:
        """Finish the trace at hand."""
        self._inbox.close()
        self._worker.stop()

    def _connect(self, transducer: str) -> _Outputs:
        topic = READING if self._has_ranges else ECHO
        outputs = _Outputs(
            topic=within(transducer, topic),
            cone=advertise(self, CONE, within(transducer, CONE)),
            cells=advertise(self, CONE_CELLS, within(transducer, CONE_CELLS)),
            scan=advertise(self, FREE_SCAN, within(transducer, FREE_SCAN)),
            scale=AmplitudeScale(),
        )
        self._inbox.add(topic, partial(self._receive, outputs), outputs.topic)
        return outputs

    @property
    def _has_ranges(self) -> bool:
        return self.parameters.value.input == "range"

    def _learn(self, payload: bytes) -> None:
        """Take up what traces do not say of their transducers."""
        try:
            self._arrays.add(array_from_cdr(payload))
        except MalformedMessageError as error:
            self.health.problem("malformed", str(error))

    def _fewest_listeners(self) -> int:
        """Subscribers of the cone topic that has the fewest."""
        return min(int(outputs.cone.get_subscription_count()) for outputs in self._outputs)

    def _renew_pipeline(self) -> None:
        parameters = PipelineParameters(reconstruction=self.parameters.value.reconstruction)
        self._pipeline = Pipeline(parameters)
        self._receivers = ReceiverSurvey(parameters.reconstruction)
        self._receiver_problems: dict[str, str] = {}
        # How many of `_JUDGEMENTS` there were, by topic.
        self._judged: dict[str, int] = {}
        # Those that are being judged.
        self._judging: dict[str, Beside[Judgement]] = {}

    def _survey(self, topic: str, trace: EchoTrace) -> None:
        """Judge the receiver by the first traces of a transducer: its pulse, and its own sound."""
        judged = self._judged.get(topic, 0)
        if judged == _JUDGEMENTS:
            return
        self._receivers.add(topic, trace)
        if self._receivers.is_in_other_units(topic) and topic not in self._judged:
            # The first trace tells: no cone is to be in other units than those after it.
            self._judged[topic] = 0
            self._learn_reception(topic)
        survey = self._receivers
        is_known = [survey.is_full(topic), survey.has_moved(topic), survey.has_turned(topic)]
        if is_known[0] and sum(is_known) > judged and topic not in self._judging:
            # Judged, whatever comes of it; robots that began at once are all at the same time.
            self._judged[topic] = sum(is_known)
            self._judging[topic] = Beside(Judging.judgement, self._receivers.judging(topic))

    def _take_up_judgements(self) -> None:
        """Go on with what was found of receivers."""
        for topic, judging in list(self._judging.items()):
            if judging.is_done:
                del self._judging[topic]
                self._receivers.take_up(topic, judging.result())
                self._learn_reception(topic)

    def _learn_reception(self, topic: str) -> None:
        self._receiver_problems[topic] = self._receivers.problem(topic)
        self._pipeline.learn_reception(self._receivers, topic)

    def _look_at_receivers(self) -> Remark | None:
        found = [f"{topic}: {said}" for topic, said in self._receiver_problems.items() if said]
        return Remark(Level.WARN, f"receiver: {'; '.join(found)}") if found else None

    def _receive(self, outputs: _Outputs, payload: bytes) -> None:
        self.health.work("received")
        depth = self.parameters.value.queue_depth * len(self._outputs)
        while len(self._queue) >= depth:
            self._queue.popleft()
            self.health.problem(
                "dropped", f"traces come faster than they are worked on; {depth} wait already"
            )
        self._queue.append(_Job(outputs, payload, time.monotonic()))

    def _step(self) -> float | None:
        """Reconstruct the trace that has waited longest."""
        try:
            job = self._queue.popleft()
        except IndexError:
            self._take_up_judgements()
            return _LOOK_S if self._judging else None
        cones: list[tuple[_Job, EchoCone]] = []
        try:
            if self._ranges is not None:
                cones.append((job, self._ranges.cone(job.payload)))
            else:
                trace = self._arrays.complete(trace_from_cdr(job.payload))
                self._survey(job.outputs.topic, trace)
                self._take_up_judgements()
                for sounding in self._collector.add(job, trace):
                    cones += self._reconstruct(sounding)
        except NoPoseError as error:
            self.health.problem("without pose", str(error))
        except MalformedMessageError as error:
            self.health.problem("malformed", str(error))
        except Exception as error:  # One odd message must not end the others' mapping.
            self.get_logger().error(traceback.format_exc())
            self.health.problem("failed", repr(error), is_error=True)
        for heard_by, cone in cones:
            self._publish(heard_by, cone)
        return 0.0

    def _reconstruct(self, sounding: list[tuple[_Job, EchoTrace]]) -> list[tuple[_Job, EchoCone]]:
        """Cones of traces of one ping, which are reconstructed together."""
        outcomes = self._pipeline.reconstruct_sounding([trace for _, trace in sounding])
        cones = []
        for (job, _), outcome in zip(sounding, outcomes, strict=True):
            if isinstance(outcome, MalformedMessageError):
                self.health.problem("malformed", str(outcome))
            elif outcome is not None:
                cones.append((job, outcome))
        return cones

    def _publish(self, job: _Job, cone: EchoCone) -> None:
        if not job.outputs.cone.get_subscription_count():
            self.health.problem("unheard", "nobody listens to the cones; does map_fusion run?")
        job.outputs.scale.add(cone)
        if problem := job.outputs.scale.problem():
            self.health.problem("implausible", problem)
        job.outputs.cone.publish(cone_to_cdr(cone))
        self.health.count("published")
        self.health.latency(time.monotonic() - job.received_s)
        if job.outputs.cells.get_subscription_count():
            job.outputs.cells.publish(self._cells_message(cone))
        if job.outputs.scan.get_subscription_count():
            free = free_scan(cone, self._mapping)
            job.outputs.scan.publish(scan_to_message(cone, *free, self._types))

    @property
    def _mapping(self) -> MappingParameters:
        return MappingParameters(resolution_m=self.parameters.value.cell_resolution_m)

    def _cells_message(self, cone: EchoCone) -> Any:
        cells = candidate_cells(cone, self._mapping)
        chosen = cells.coefficient <= self.parameters.value.greatest_coefficient
        x_m, y_m = cells.centers_m[chosen].T
        columns = {
            "x": x_m,
            "y": y_m,
            "z": np.full(len(x_m), cone.pose.position_m[2] + cone.object_rise_m),
            "coefficient": cells.coefficient[chosen],
        }
        return points_to_message(columns, cone.frame_id, cone.stamp_ns, self._types)


def main() -> None:
    """Run the node."""
    run_node(ConeReconstructor, has_loops=True)


if __name__ == "__main__":
    main()
