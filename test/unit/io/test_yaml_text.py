"""YAML from anywhere ends in plain data or in one short line, soon and in little memory."""

from pathlib import Path

import pytest

from usmap_ros.errors import ConfigurationError
from usmap_ros.io.yaml_files import read_mapping
from usmap_ros.io.yaml_text import YamlTextError, parse_yaml


def bomb(line: str, levels: int = 12) -> str:
    return "\n".join(["b0: &b0 {x: 1}", *(line.format(n=n, m=n - 1) for n in range(1, levels))])


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("a: 1\nb: !!int foo", "line 2: 'foo' is no valid int"),
        ("a: !!float {b: 1}", "line 1: "),
        ("a: 2001-99-99", "line 1: '2001-99-99' is no valid timestamp"),
        ("a: " + "9" * 5000, "line 1: '99999"),
        ("a: !!timestamp x", "line 1: 'x' is no valid timestamp"),
        ("a: " + "[" * 1500, "line 1: nests deeper than 32 groups"),
        ("{a: " * 1500, "line 1: nests deeper than 32 groups"),
        (bomb("b{n}: &b{n} [" + "*b{m}, " * 9 + "]"), "stands for more than 200000 values"),
        (bomb("b{n}: &b{n} {{<<: [" + "*b{m}, " * 9 + "]}}"), "stands for more than 200000 values"),
        ("a: &a [*a]", "line 1: *a stands for a group that it is in"),
        ("? [a]\n: b", "line 1: a key is no text"),
        ("a: 1\na: 2", "line 2: 'a' stands twice"),
        ("a: 1\nb: \x00", "line 2: has a character that YAML does not allow"),
        ("a: !!python/object/apply:os.system [id]", "line 1: could not determine a constructor"),
        ("a: !<" + "x" * 5000 + "> 1", "line 1: could not determine a constructor"),
        ("# \n" * 400_000, "is larger than 1 MiB"),
    ],
)  # fmt: skip
def test_a_bad_text_is_one_short_line(text: str, cause: str, tmp_path: Path) -> None:
    with pytest.raises(YamlTextError) as raised:
        parse_yaml(text)
    assert cause in str(raised.value)
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 250

    path = tmp_path / "some.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationError) as refused:
        read_mapping(path)
    assert str(refused.value) == f"{path}: {raised.value}"


def test_what_people_write_is_read() -> None:
    text = "base: &base {a: 1, b: [x, 2.5, null]}\nother: {<<: *base, a: 2}\nwhen: 2001-01-01"
    content = parse_yaml(text)
    assert content["other"] == {"a": 2, "b": ["x", 2.5, None]}
    assert parse_yaml("") is None
