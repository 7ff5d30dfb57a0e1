"""``python -m usmap_ros``: the command line, where its program is not on the search path."""

from usmap_ros.cli import main

if __name__ == "__main__":
    main()
