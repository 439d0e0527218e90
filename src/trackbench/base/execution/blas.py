"""How many threads the linear algebra takes."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

log = logging.getLogger(__name__)

_limited = ContextVar("limited", default=False)


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread; also a decorator.

    The products of a filter are so small that a second thread costs more than it saves, and many times more where the
    processor is shared.
    """
    if _limited.get():
        yield
        return
    # Takes some 10 ms, which only the commands that compute shall wait for.
    from threadpoolctl import threadpool_limits

    token = _limited.set(True)
    try:
        with threadpool_limits(1, user_api="blas"):
            log.info("linear algebra (BLAS) is limited to one thread")
            yield
    finally:
        _limited.reset(token)
