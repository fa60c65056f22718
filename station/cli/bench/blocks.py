"""Blocks of a bench file that were measured: how they are printed, and the day on which they are due again."""

from __future__ import annotations

import json
import sys
from datetime import date, datetime, timedelta

from recipes import RecipeError
from recipes.text.yaml_source import parse_source
from station.documents.entries import Plain, plain
from station.errors import StationError

YEAR = timedelta(days=365)
DIGITS = 6


def flow(values: Plain) -> str:
    """Return a mapping as one line of YAML."""
    return "{" + ", ".join(f"{key}: {value}" for key, value in values.items()) + "}"


def scalar(value: object) -> str:
    """Return one value as YAML; a text is in quotes where it would not be read back as it is (a serial of digits)."""
    if not isinstance(value, str):
        return str(value)
    try:
        read = parse_source(f"text: {value}\n".encode(), "").data
    except RecipeError:
        read = None
    return value if read == {"text": value} else json.dumps(value, ensure_ascii=False)


def print_block(block: object, yaml: str, *, as_json: bool) -> None:
    """Print a block of a bench file, a class, as YAML to be pasted or as JSON."""
    sys.stdout.write(json.dumps(plain(block), ensure_ascii=False) + "\n" if as_json else yaml)


def rounded(value: float) -> float:
    """Return a value with as many digits as a bench file shall show."""
    return float(f"{value:.{DIGITS}g}")


def day_of(text: str) -> date:
    """Return the day of a moment in ISO 8601."""
    return datetime.fromisoformat(text).date()


def due_day(text: str | None, made: date) -> date:
    """Return the day given, or a year after it was made."""
    if text is None:
        return made + YEAR
    try:
        due = date.fromisoformat(text)
    except ValueError:
        raise StationError(f"--due: found '{text}'; expected a date such as 2027-03-31") from None
    if due <= made:
        raise StationError(f"--due: found {due}; expected a day after the measurement, which was on {made}")
    return due
