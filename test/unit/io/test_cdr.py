import numpy as np
import pytest

from usmap_ros.errors import MalformedMessageError
from usmap_ros.io.cdr import BYTE, COUNT, FLOAT, CdrReader, CdrWriter, Layout

FLOAT64 = np.dtype(np.float64)
DOUBLE = Layout.of(8, "d")


def test_fields_lie_where_the_specification_has_them() -> None:
    writer = CdrWriter()
    writer.numbers(BYTE, 7)
    writer.text("ab")
    writer.numbers(DOUBLE, 0.0)
    expected = "00010000070000000300000061620000000000000000000000000000"
    assert writer.message() == bytes.fromhex(expected)


def test_a_sequence_of_nothing_is_not_aligned() -> None:
    writer = CdrWriter()
    writer.sequence(FLOAT64, [])
    writer.numbers(FLOAT, 1.0)
    assert len(writer.message()) == 4 + 4 + 4
    reader = CdrReader(writer.message())
    assert len(reader.sequence(FLOAT64)) == 0
    assert reader.numbers(FLOAT) == (1.0,)
    reader.end()


@pytest.mark.parametrize("length", [b"\0\0\0\0", b"\1\0\0\0\0"])
def test_an_empty_text_may_be_without_its_zero(length: bytes) -> None:
    assert CdrReader(b"\0\1\0\0" + length).text() == ""


def test_numbers_of_the_other_byte_order_are_turned() -> None:
    reader = CdrReader(bytes.fromhex("00000000 00000002 3ff00000 00000000 40000000 00000000"))
    # Behind a length of four bytes, doubles begin at the next multiple of eight.
    with pytest.raises(MalformedMessageError, match="ends after 24 bytes"):
        reader.sequence(FLOAT64)
    reader = CdrReader(bytes.fromhex("00000000 00000001 00000000 3ff00000 00000000"))
    np.testing.assert_array_equal(reader.sequence(FLOAT64), [1.0])


@pytest.mark.parametrize("head", [b"", b"\0\1\0", b"\0\3\0\0", b"\0\7\0\0", b"\1\1\0\0"])
def test_other_encodings_are_refused(head: bytes) -> None:
    with pytest.raises(MalformedMessageError, match="does not begin as CDR"):
        CdrReader(head)


def test_a_length_beyond_the_message_is_refused_at_once() -> None:
    reader = CdrReader(b"\0\1\0\0" + b"\xff\xff\xff\xff" + bytes(100))
    with pytest.raises(MalformedMessageError, match="ends after 108 bytes"):
        reader.sequence(FLOAT64)


def test_a_text_that_is_none_is_refused() -> None:
    with pytest.raises(MalformedMessageError, match="not UTF-8"):
        CdrReader(b"\0\1\0\0" + b"\3\0\0\0\xff\xff\0").text()


@pytest.mark.parametrize(("rest", "is_too_long"), [(b"\0" * 3, False), (b"\0" * 4, True)])
def test_a_message_may_be_padded_and_no_more(rest: bytes, is_too_long: bool) -> None:
    reader = CdrReader(b"\0\1\0\0" + b"\1\0\0\0" + rest)
    reader.numbers(COUNT)
    if is_too_long:
        with pytest.raises(MalformedMessageError, match="goes on after its 8 bytes"):
            reader.end()
    else:
        reader.end()
