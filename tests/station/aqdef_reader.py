"""AQDEF files read by another program, which needs pandas."""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path

import pytest

from station.quality.dfq.fields import ENCODING

with pytest.MonkeyPatch.context() as patch:
    patch.setattr(sys, "path", [one for one in sys.path if Path(one).name != "without_pandas"])
    import aqdefreader


def by_another_program(content: bytes) -> aqdefreader.DfqFile:
    """Return a file as the other program reads it, without what it prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        return aqdefreader.DfqFile(content.decode(ENCODING).splitlines())
