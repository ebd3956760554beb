"""Work: counted in units that no machine changes, and shared among processes."""

import os


def one_thread() -> None:
    """Keep linear algebra to one thread, unless the user says how many; called before NumPy loads.

    Matrices of a few rows are done sooner than threads that others keep from the cores meet.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
