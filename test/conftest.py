"""Set up for all tests."""

import os

# Before NumPy is imported: the matrices are small, and the threads of the linear algebra would
# only wait for each other, most of all where several test processes share the machine.
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")
