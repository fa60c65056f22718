"""How further processes of this program are started: by the same interpreter, with modules from where it is installed.

`python -m` looks for modules in the working folder first. A queue.py there would end a run before it begins, and a
numpy.py would evaluate it.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

FROM_WORKING_FOLDER = "PYTHONSAFEPATH"
"""Where this is set, Python takes no module from the working folder."""


def own_module(module: str, *words: str | Path) -> list[str]:
    """Return the command that runs a module of this program."""
    return [sys.executable, "-P", "-m", module, *map(str, words)]


def keep_out_of_working_folder() -> None:
    """Have processes that Python's own library starts for this one keep out of it too."""
    os.environ[FROM_WORKING_FOLDER] = "1"


@contextmanager
def loading() -> Iterator[None]:
    """Load what stays for good: Python does not look for what is over in it meanwhile, nor ever after.

    It would look some hundred times, in a tenth of the time that the loading takes.
    """
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was:
            gc.enable()
