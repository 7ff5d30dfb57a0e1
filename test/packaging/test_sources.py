"""What must not be found in the project's files."""

import re
from collections import Counter

# Put together from pieces, or this file would be the first to be found.
HOSTS = ["py" + "pi.", "pythonhosted" + ".org", "anaconda" + ".org", "packages.ros" + ".org"]
FOLDERS = ["/ho" + "me/", "/ro" + "ot/", "/wo" + "rk/", "/Us" + "ers/", "/tm" + "p/"]


def test_no_file_names_a_registry_host_or_a_path_of_one_machine(root, sources):
    # A path is one only where it starts: the same letters further down another path are none.
    hosts = "|".join(re.escape(host) for host in HOSTS)
    folders = "|".join(re.escape(folder) for folder in FOLDERS)
    forbidden = re.compile(rf"({hosts}|(?<![\w.$}}{{)/*-])(?:{folders})\w)".encode())

    found = {
        f"{path}: {match.group().decode()}"
        for path in sources
        for match in forbidden.finditer((root / path).read_bytes())
    }

    assert not found


def test_no_lock_file_of_one_tool(sources):
    assert not {"uv.lock", "poetry.lock", "Pipfile.lock"} & {path.name for path in sources}


#: What dependencies do not document, and the one file that may use it: it says why.
PRIVATE = {
    r"rclpy\.impl|rclpy_implementation": {"src/usmap_ros/nodes/plumbing/wait_set_inbox.py"},
    r"numba\.(?!extending\b|njit\b|__version__\b)\w+\.": set(),
    r"^ *from (?:numba\.(?!extending\b)|rclpy\._|pydantic\._|numpy\._|scipy\._)": set(),
}


def test_no_private_parts_of_dependencies_but_in_one_file(root, sources):
    code = {
        str(path): (root / path).read_text(encoding="utf-8")
        for path in sources
        if path.suffix == ".py" and path.parts[0] == "src"
    }
    for pattern, allowed in PRIVATE.items():
        found = {path for path, text in code.items() if re.search(pattern, text, re.MULTILINE)}
        assert found == allowed


def test_each_public_class_has_a_name_of_its_own(root, sources):
    code = [
        (root / path).read_text(encoding="utf-8")
        for path in sources
        if path.suffix == ".py" and path.parts[0] == "src"
    ]
    names = Counter(
        name for text in code for name in re.findall(r"^class ([A-Z]\w*)", text, re.MULTILINE)
    )
    assert names
    assert not [name for name, count in names.items() if count > 1]
