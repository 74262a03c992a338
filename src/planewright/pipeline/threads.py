"""How many threads the libraries below us may use while a run goes on."""

from collections.abc import Generator
from contextlib import contextmanager

import cv2
import numba
from threadpoolctl import threadpool_limits


@contextmanager
def limited_threads(threads: int) -> Generator[None]:
    """One thread for linear algebra, which is faster on our small systems and gives the same sums every time; `threads` for pixels."""
    before_cv, before_numba = cv2.getNumThreads(), numba.get_num_threads()
    with threadpool_limits(limits=1):
        cv2.setNumThreads(threads)
        numba.set_num_threads(min(threads, before_numba))
        try:
            yield
        finally:
            cv2.setNumThreads(before_cv)
            numba.set_num_threads(before_numba)
