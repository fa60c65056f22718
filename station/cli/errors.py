"""How a command that fails ends: its exit code, and what is said to a person and to a program."""

from __future__ import annotations

import json
import os
import re
import sys
import tempfile
import time
import traceback
from dataclasses import asdict, dataclass
from errno import ENAMETOOLONG
from typing import NoReturn

from station.errors import StationError
from station.wall_clock import WALL_CLOCK

PLACE = re.compile(r"^(?P<option>--[a-z-]+): found (?P<found>.*?); allowed (?:are |is )?(?P<allowed>.*)$", re.DOTALL)


@dataclass(frozen=True, slots=True, kw_only=True)
class InputProblem:
    """One problem with the input; None for what the error does not say by itself.

    row: of a table, from 1 below its header. column: of a table its name, of another text its position.
    """

    file: str | None = None
    line: int | None = None
    row: int | None = None
    column: int | str | None = None
    option: str | None = None
    found: str
    allowed: str | None = None
    hint: str | None = None


def errors_of(error: BaseException) -> list[InputProblem]:
    """Return the problems of an error."""
    problems = getattr(error, "problems", None)
    if problems:
        return [
            InputProblem(
                file=problem.path or None,
                line=problem.line or None,
                row=getattr(problem, "row", None),
                column=problem.column or None,
                option=problem.option or None,
                found=problem.found,
                allowed=problem.allowed or None,
                hint=problem.hint or None,
            )
            for problem in problems
        ]
    message = getattr(error, "format_message", error.__str__)()
    named = PLACE.match(str(message))
    if named is None:
        return [InputProblem(found=str(message))]
    return [InputProblem(option=named["option"], found=named["found"], allowed=named["allowed"])]


def errors_json(error: BaseException) -> str:
    """Return the JSON object, one line with its end."""
    return json.dumps({"errors": [asdict(one) for one in errors_of(error)]}, ensure_ascii=False) + "\n"


EXIT_BAD_INPUT = 2
LONGEST_NAME, LONGEST_PATH = 255, 4095
"""What a file system takes, in bytes; most characters have one."""

SHOWN = 40
EXIT_BENCH = 4
EXIT_PROGRAM_ERROR = 70
"""The program itself failed (EX_SOFTWARE of sysexits.h): none of the codes that say something about a unit."""

EXIT_NOBODY_READS = 141
"""As of a process that SIGPIPE ended: the reader of standard output went away, and no code may be taken for a PASS."""


DAY_S = 86400
DAYS_OF_YEAR = 366


def refuse_time_zone() -> None:
    """Refuse a clock that is a day or more off UTC, as TZ=XXX-99 has it: Python tells no local time by it.

    Looked at here once, as any command may tell a time: each day of a year, for summer time may be what is wrong, and
    `time.altzone` knows nothing of one that begins in January and ends before July.

    Raises:
        StationError: the computer's time zone is such a one.

    """
    now = WALL_CLOCK.now().timestamp()
    off_s = max((time.localtime(now + day * DAY_S).tm_gmtoff for day in range(DAYS_OF_YEAR)), key=abs)
    if abs(off_s) >= DAY_S:
        raise StationError(
            f"time zone of this computer ({os.environ.get('TZ') or 'TZ is not set'}): found {off_s / 3600:+.0f} h off "
            "UTC; allowed is less than 24 h. Set the environment variable TZ to a zone such as Europe/Berlin"
        )


def _bad_input() -> tuple[type[Exception], ...]:
    """Return the errors that a person can mend. Called when one was raised: its module is loaded then anyway."""
    loaded = sys.modules
    names = (
        ("recipes", "RecipeError"),
        ("analysis.trace.errors", "AnalysisError"),
        ("virtual_bench.errors", "VirtualBenchError"),
    )
    return (StationError, *(getattr(loaded[module], name) for module, name in names if module in loaded))


def _too_long(error: Exception) -> StationError | None:
    """Return what is said of a name that no file can have, as a stuttering scanner gives it; None for another error.

    The program's own names are short: a name that is too long was given by a person.
    """
    if not isinstance(error, OSError) or error.errno != ENAMETOOLONG:
        return None
    name = str(error.filename)
    return StationError(
        f"{name[:SHOWN]!r}...: found {len(os.fsencode(name))} bytes; allowed are {LONGEST_NAME} for the name of a file "
        f"or folder, and {LONGEST_PATH} for a whole path. Scan or type it again"
    )


def can_be_mended(error: Exception) -> bool:
    """Whether a person can mend what was raised: bad input, not a failure of the program."""
    # The command line's own refusals show themselves; their class is not part of typer's interface.
    return hasattr(error, "format_message") or isinstance(error, _bad_input()) or _too_long(error) is not None


def refuse(error: Exception) -> NoReturn:
    """Tell what is wrong with the input, in words and, to a program that asked for it, as JSON; exit."""
    error = _too_long(error) or error
    show = getattr(error, "show", None)
    if show is not None:
        show()
    else:
        sys.stderr.write(f"{error}\n")
    code = getattr(error, "exit_code", EXIT_BAD_INPUT)
    if code == EXIT_BAD_INPUT and "--json" in sys.argv[1:]:
        sys.stdout.write(errors_json(error))
    sys.exit(code)


def program_failed(error: Exception) -> NoReturn:
    """Tell in one plain line of an error that nobody expected; its traceback goes to a file; exit."""
    what = f"the program failed: {type(error).__name__}: {' '.join(str(error).split())}".rstrip(": ")
    try:
        handle, name = tempfile.mkstemp(prefix="lostmotion-error-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(f"{' '.join(sys.argv)}\n\n{''.join(traceback.format_exception(error))}")
    except OSError as refused:
        where = f"its traceback could not be stored ({refused.strerror})"
    else:
        where = f"please report it with {name}"
    sys.stderr.write(f"{what}; nothing is said about the unit. {where}\n")
    sys.exit(EXIT_PROGRAM_ERROR)


def nobody_reads() -> NoReturn:
    """Leave quietly: what is still buffered goes nowhere, instead of raising once more when the interpreter ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.__stdout__.fileno() if sys.__stdout__ else 1)
    sys.exit(EXIT_NOBODY_READS)
