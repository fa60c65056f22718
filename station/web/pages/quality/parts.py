"""What the parts of the page of quality are built of: cards, pictures, and figures that are made beside the server."""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Callable
from datetime import date
from html import escape
from typing import TypeVar

from nicegui import ui

from analysis.trace.errors import AnalysisError
from recipes import RecipeError
from station.errors import StationError
from station.web.languages import Words
from station.web.pages.quality_figures import Options
from station.web.pages.words import on_page
from station.web.station import Station

Found = TypeVar("Found")

NO_NUMBER = "'{found}' is no number. Write known values and tolerances with a point, several with ; between: 0.37; 115"


async def made_beside(
    station: Station, make: Callable[..., Found], *asked: object, say: Words, said: Callable[[str], object]
) -> Found | None:
    """Return what is made of the station's folder beside the server; None where it cannot be, which is said by say."""
    try:
        return await asyncio.to_thread(station.evaluations.figure, make, station.data, *asked)
    except (StationError, AnalysisError, RecipeError) as error:
        said(say(on_page(str(error).replace(f"{station.data}: ", "").replace(f"{station.data}/", ""))))
        return None


def card(head: str) -> ui.element:
    """Return a card with its head."""
    found = ui.element("section").classes("lm-card lm-quality-card")
    with found:
        ui.html(f"<h2>{escape(head)}</h2>", sanitize=False)
    return found


def draw(chart: ui.echart, options: Options) -> None:
    """Show a picture in place of the one before."""
    chart.options.clear()
    chart.options.update(options)
    chart.update()


def day_of(text: str | None) -> date | None:
    """Return the day of a field, None where it has none."""
    try:
        return date.fromisoformat(text or "")
    except ValueError:
        return None


def numbers_of(given: str | None) -> list[float]:
    """Return numbers with semicolons between; ValueError by what is none.

    A comma or a blank stands between no two numbers, for some write 0,37 and 1 000.
    """
    found = []
    for one in filter(None, map(str.strip, re.split(r"[;\uff1b]", given or ""))):
        try:
            found.append(float(one))
        except ValueError:
            raise ValueError(one) from None
        if not math.isfinite(found[-1]):
            raise ValueError(one)
    return found
