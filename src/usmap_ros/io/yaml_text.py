"""The one reader of YAML: plain data only, and bounded, since files come from anywhere.

A few lines of YAML can stand for terabytes (aliases of aliases), nest deeper than Python can
follow, or hold values that no parser of numbers or dates takes.  PyYAML bounds none of it, and
keeps the last of two keys alike in silence; what stands here is no parser but those checks, hung
into PyYAML's own.  All of it ends in one `ValueError` whose text says where.
"""

from pathlib import Path
from typing import Any

import yaml

from usmap_ros.errors import FileError, file_errors, shortened

#: Largest file: some ten thousand walls.
MAX_BYTES = 2**20
#: Groups in groups; scenarios have six.
MAX_DEPTH = 32
#: Values, those counted that aliases stand for.
MAX_VALUES = 200_000


class YamlTextError(ValueError):
    """Text that is no YAML, or more of it than is believed."""


def parse_yaml(text: str) -> Any:
    """Plain data from YAML.

    Raises
    ------
    YamlTextError
        In one short line: where, as far as it is known, and what is wrong.
    """
    if len(text) > MAX_BYTES:
        raise YamlTextError(f"is larger than {MAX_BYTES // 2**20} MiB")
    try:
        return yaml.load(text, Loader=_BoundedLoader)
    except yaml.reader.ReaderError as error:
        line = text.count("\n", 0, int(error.position)) + 1
        raise YamlTextError(f"line {line}: has a character that YAML does not allow") from error
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}: " if mark else ""
        raise YamlTextError(where + shortened(error.problem or "is not YAML", 150)) from error
    except yaml.YAMLError as error:
        raise YamlTextError("is not a YAML file") from error


def read_yaml(path: Path, error_class: type[FileError]) -> Any:
    """Plain data from a YAML file.

    Parameters
    ----------
    path : path
        YAML in UTF-8, at most 1 MiB.
    error_class : type
        Of the error that is raised.

    Raises
    ------
    FileError
        Of that class, if the file is missing, unreadable or no YAML.
    """
    content = b""
    try:
        # One byte more than is taken shows that there are too many.
        with file_errors(error_class, path, "read"), path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
        return parse_yaml(content.decode("utf-8"))
    except UnicodeDecodeError as error:
        if len(content) > MAX_BYTES:
            raise error_class(path, f"is larger than {MAX_BYTES // 2**20} MiB") from error
        raise error_class(path, "is not a text file") from error
    except YamlTextError as error:
        raise error_class(path, str(error)) from error
    except ValueError as error:
        # The name itself is none: it holds a zero byte.
        raise error_class(path, "is not the name of a file") from error


class _BoundedLoader(yaml.SafeLoader):
    """Plain data, of bounded depth and size; keys are scalars, none twice in a group."""

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0
        # Values that each finished node stands for, by its identity: the tree keeps them alive.
        self._sizes: dict[int, int] = {}

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Read a node, and count what it stands for."""
        event: yaml.Event = self.peek_event()  # type: ignore[no-untyped-call]  # stubs have none
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise _refused(f"nests deeper than {MAX_DEPTH} groups", event.start_mark)
        node: yaml.Node | None = super().compose_node(parent, index)
        self._depth -= 1
        if isinstance(event, yaml.AliasEvent):
            if id(node) not in self._sizes:
                raise _refused(
                    f"*{event.anchor} stands for a group that it is in", event.start_mark
                )
        elif node is not None:
            self._sizes[id(node)] = 1 + sum(self._sizes[id(part)] for part in _parts(node))
            if self._sizes[id(node)] > MAX_VALUES:
                raise _refused(f"stands for more than {MAX_VALUES} values", node.start_mark)
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """Build a value; what a parser of numbers or dates cannot read is an error of YAML's."""
        try:
            return super().construct_object(node, deep)
        except (ValueError, TypeError, LookupError, AttributeError, ArithmeticError) as error:
            kind = node.tag.rpartition(":")[2]
            raise _refused(
                f"{shortened(str(node.value), 40)!r} is no valid {shortened(kind, 20)}",
                node.start_mark,
            ) from error

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Build a mapping whose keys differ, where YAML would keep the last in silence."""
        # An odd tag leads anything here.
        if node.id != "mapping":
            raise _refused("is no group of keys", node.start_mark)
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise _refused("a key is no text", key.start_mark)
            # Several groups may be merged into one.
            if key.value in seen and key.tag != "tag:yaml.org,2002:merge":
                raise _refused(f"{shortened(key.value, 40)!r} stands twice", key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _parts(node: yaml.Node) -> list[yaml.Node]:
    """Nodes right below a node."""
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _refused(problem: str, mark: Any) -> yaml.constructor.ConstructorError:
    return yaml.constructor.ConstructorError(None, None, problem, mark)
