"""Write what follows from the code: docs/reference.md, docs/scenarios.md, and parameter files.

Run it after a change to a topic, service, parameter or key of scenarios: ``make docs``.  With
--check nothing is written; exit status 1 says that something would change.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from usmap_ros.io.yaml_files import dump_yaml
from usmap_ros.live.interfaces import NODES, NodeInterface, Topic
from usmap_ros.parameters import PipelineParameters
from usmap_ros.parameters.fields import constraints_of, flat_fields, flat_values, is_among, unit_of
from usmap_ros.simulation import Scenario

ROOT = Path(__file__).parents[1]

INTRODUCTION = """\
# Reference of the nodes

<!-- Written by tools/make_reference.py from the code; "make docs" brings it up to date. -->

Every topic, service and parameter of every node. How the nodes work together is in
[nodes.md](nodes.md).

Topic names without a leading slash are relative: namespaces and remappings apply to them. QoS is
that of the publisher; the nodes' own subscriptions keep ten times as many messages.
"""

SCENARIO_EXAMPLE = ROOT / "bags/yard.yaml"
SCENARIOS = """\
# All keys of a scenario

<!-- Written by tools/make_reference.py from the code; "make docs" brings it up to date. -->

`usmap simulate SCENARIO.yaml -o BAG` simulates what such a file says; the same file gives the same
recording. An unknown key is an error that names its place. Examples stand in
[config/scenarios](../config/scenarios); this one is that of the recording in [bags/](../bags):

```yaml
{example}```

A section is a mapping of its own, a name with `[]` a list of them; of sections with a `kind` there
is one for each. Their models are in `src/usmap_ros/simulation/models`, the file as a whole is
`src/usmap_ros/simulation/scenario.py`.
"""

DEFAULTS = """\
# Every parameter of reconstruction and mapping at its default: `usmap map BAG -o DIR -p FILE.yaml`.
# A file needs only those that differ. Written by tools/make_reference.py from the code.

"""

MANAGED = """\
It is a [managed node](https://design.ros2.org/articles/node_lifecycle.html) with the usual services
`~/change_state`, `~/get_state` and so on.
"""


def files() -> dict[Path, str]:
    """Content of every generated file."""
    content = {
        ROOT / "docs/reference.md": reference(),
        ROOT / "docs/scenarios.md": scenario_page(),
        ROOT / "config/parameters/defaults.yaml": DEFAULTS + dump_yaml(PipelineParameters()),
    }
    for node in NODES:
        content[ROOT / f"config/parameters/{node.name}.yaml"] = example(node)
    return content


def reference() -> str:
    """The reference page."""
    contents = "".join(f"- [{node.name}](#{node.name}): {node.summary}\n" for node in NODES)
    return "\n".join([INTRODUCTION, contents, *(section(node) for node in NODES)])


def section(node: NodeInterface) -> str:
    """What the page says of one node."""
    parts = [f"## {node.name}\n", f"{node.summary}\n"]
    if node.is_managed:
        parts.append(MANAGED)
    for title, topics in (("Subscribes to", node.subscribes), ("Publishes", node.publishes)):
        if topics:
            parts += [f"### {title}\n", topic_table(topics)]
    if node.services:
        rows = [[f"`{s.name}`", f"`{s.service_type}`", s.description] for s in node.services]
        parts += ["### Services\n", table(["Service", "Type", "Meaning"], rows)]
    parts += ["### Parameters\n", parameter_table(node)]
    return "\n".join(parts)


def topic_table(topics: tuple[Topic, ...]) -> str:
    """Table of topics."""
    rows = []
    for topic in topics:
        condition = f" Only if {topic.condition}." if topic.condition else ""
        rows.append(
            [
                f"`{topic.name}`",
                f"`{topic.message_type}`",
                str(topic.qos),
                topic.description + condition,
            ]
        )
    return table(["Topic", "Type", "QoS", "Meaning"], rows)


def parameter_table(node: NodeInterface) -> str:
    """Table of parameters; the last column says when each may be changed."""
    defaults = flat_values(node.parameters())
    rows = [
        [
            f"`{name}`",
            _default(defaults[name]),
            unit_of(info),
            constraints_of(info),
            _changeable(node, name),
            info.description or "",
        ]
        for name, info in flat_fields(node.parameters)
    ]
    return table(["Parameter", "Default", "Unit", "Constraint", "Can be set", "Meaning"], rows)


def _default(value: object) -> str:
    if isinstance(value, str):
        return f"`{value}`" if value else "empty"
    if isinstance(value, list):
        return ", ".join(f"`{item}`" for item in value if item) or "empty"
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def _changeable(node: NodeInterface, name: str) -> str:
    if is_among(name, node.parameters.fixed):
        return "at the start"
    while_configured = getattr(node.parameters, "fixed_while_configured", frozenset())
    return "while unconfigured" if is_among(name, while_configured) else "always"


def scenario_page() -> str:
    """The page of all scenario keys: a section for the file, and one for each model in it."""
    parts = [SCENARIOS.format(example=SCENARIO_EXAMPLE.read_text(encoding="utf-8"))]
    waiting: dict[type[BaseModel], str] = {Scenario: ""}
    told: set[type[BaseModel]] = set()
    while waiting:
        model = next(iter(waiting))
        path = waiting.pop(model)
        told.add(model)
        meaning = (model.__doc__ or "").split(";")[0].rstrip(".")
        parts.append(f"## {path or 'The file'}\n\n{meaning}.\n")
        rows = [_scenario_row(name, info) for name, info in model.model_fields.items()]
        parts.append(table(["Key", "Default", "Unit", "Constraint", "Meaning"], rows))
        for name, info in model.model_fields.items():
            for inner in models_in(info.annotation):
                if inner not in told:
                    waiting.setdefault(inner, _section(f"{path}.{name}".lstrip("."), info, inner))
    return "\n".join(parts)


def _section(path: str, info: FieldInfo, model: type[BaseModel]) -> str:
    """Heading of a model's section: where it stands, and its kind if there are several."""
    kind = model.model_fields.get("kind")
    mark = "[]" if "list" in str(info.annotation) else ""
    return path + mark + (f" ({get_args(kind.annotation)[0]})" if kind else "")


def _scenario_row(name: str, info: FieldInfo) -> list[str]:
    is_section = bool(models_in(info.annotation))
    if is_section:
        default = "section"
    elif info.is_required():
        default = "needed"
    else:
        default = "none" if info.default is None else _default(info.default)
    constraint = "" if is_section else constraints_of(info)
    return [f"`{name}`", default, unit_of(info), constraint, info.description or ""]


def models_in(annotation: object) -> list[type[BaseModel]]:
    """Models that a value of a type may be, or hold, in the order in which they stand."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def table(captions: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""

    def line(cells: list[str]) -> str:
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |\n"

    return line(captions) + line(["---"] * len(captions)) + "".join(line(row) for row in rows)


def example(node: NodeInterface) -> str:
    """Parameter file of a node with every default, for any namespace."""
    text = dump_yaml(node.parameters())
    lines = [f"    {line}" if line else line for line in text.splitlines()]
    head = [
        f"# Every parameter of {node.name} with its default. Written by tools/make_reference.py.",
        f"/**/{node.name}:",
        "  ros__parameters:",
    ]
    return "\n".join([*head, *lines]) + "\n"


def outdated() -> Iterator[Path]:
    """Files that are not what the code says."""
    for path, content in files().items():
        if not path.exists() or path.read_text(encoding="utf-8") != content:
            yield path


def main() -> None:
    """Write or check."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="write nothing")
    arguments = parser.parse_args()
    stale = list(outdated())
    for path in stale:
        print(path.relative_to(ROOT))
        if not arguments.check:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(files()[path], encoding="utf-8")
    sys.exit(1 if stale and arguments.check else 0)


if __name__ == "__main__":
    main()
