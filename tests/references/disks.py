"""A disk that is full."""

import contextlib
import resource


@contextlib.contextmanager
def files_up_to(size):
    """Refuse larger files with EFBIG, of this process and those it starts, without mounting a small disk."""
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, usual[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
