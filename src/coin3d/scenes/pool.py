"""Work for processes, or for this one: the same calls either way."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any

_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class InlineExecutor(Executor):
    """Does the work at once, in the calling process."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run and return the finished result; an exception is raised here, where its traceback is whole."""
        future: Future[Any] = Future()
        future.set_result(fn(*args, **kwargs))
        return future


@contextmanager
def single_threaded_processes(workers: int, initializer: Callable[[], None]) -> Iterator[Executor]:
    """Spawned processes that leave each other's cores alone; with one worker the calling process does the work.

    Pending work is dropped when the block ends with an error.
    """
    if workers == 1:
        initializer()
        yield InlineExecutor()
        return
    before = {name: os.environ.get(name) for name in _THREAD_VARIABLES}
    # libraries read these while they are imported, which is before an initializer could set them
    os.environ.update(dict.fromkeys(_THREAD_VARIABLES, "1"))
    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"), initializer=initializer)
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
