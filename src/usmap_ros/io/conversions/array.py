"""``usmap_msgs/TransducerArray``: who pings at once, and what traces do not say of their pulses."""

from dataclasses import replace

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.cdr import BYTE, COUNT, CdrReader, CdrWriter, Layout, Payload
from usmap_ros.io.conversions.fields import (
    read_bare_pose,
    read_header,
    read_transducer,
    write_bare_pose,
    write_header,
    write_transducer,
)
from usmap_ros.pings.transducer_array import ArrayElement, TransducerArray

_SWEEP = Layout.of(8, "d")


def array_from_cdr(payload: Payload) -> TransducerArray:
    """`TransducerArray` from a serialized ``usmap_msgs/TransducerArray``.

    Raises
    ------
    MalformedMessageError
        If it cannot be decoded, or a field holds what no robot could carry.
    """
    reader = CdrReader(payload)
    stamp_ns, frame_id = read_header(reader)
    (count,) = reader.numbers(COUNT)
    # A count that is not true ends with the bytes: each element takes some.
    elements = tuple(_read_element(reader) for _ in range(count))
    reader.end()
    array = TransducerArray(stamp_ns=stamp_ns, frame_id=frame_id, elements=elements)
    try:
        array.validate()
    except MalformedMessageError as error:
        raise MalformedMessageError(f"TransducerArray.{error.field}", error.cause) from error
    return array


def array_to_cdr(array: TransducerArray) -> bytes:
    """Serialized ``usmap_msgs/TransducerArray`` of a `TransducerArray`.

    Raises
    ------
    MalformedMessageError
        If its stamp does not fit a message.
    """
    writer = CdrWriter()
    write_header(writer, array.stamp_ns, array.frame_id)
    writer.numbers(COUNT, len(array.elements))
    for element in array.elements:
        writer.text(element.child_frame_id)
        write_bare_pose(writer, element.mount)
        writer.numbers(BYTE, element.emits)
        write_transducer(writer, element.transducer)
        writer.numbers(_SWEEP, element.transducer.pulse.sweep_hz)
    return writer.message()


def _read_element(reader: CdrReader) -> ArrayElement:
    child_frame_id, mount = reader.text(), read_bare_pose(reader)
    (emits,) = reader.numbers(BYTE)
    transducer = read_transducer(reader)
    (sweep_hz,) = reader.numbers(_SWEEP)
    pulse = replace(transducer.pulse, sweep_hz=sweep_hz)
    return ArrayElement(
        child_frame_id=child_frame_id,
        mount=mount,
        emits=bool(emits),
        transducer=replace(transducer, pulse=pulse),
    )
