"""What must not be found in the project's files."""

import re

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
