"""The load that a recipe's text plans, as a picture over time, and the line above it."""

from __future__ import annotations

from station.run.screen.progress import clock
from station.web.languages import Words
from station.web.pages.quality_figures import Options
from station.web.recipe_text.check import LookedAt

INK, QUIET_INK, LINE_INK = "#23282b", "#c2c7ca", "#2f4a5e"

NO_CURVE = {
    False: (
        "✕ {count} message. The load curve cannot be shown.",
        "✕ {count} messages. The load curve cannot be shown.",
    ),
    True: (
        "✕ {count} message, the first in {where}. The load curve cannot be shown.",
        "✕ {count} messages, the first in {where}. The load curve cannot be shown.",
    ),
}
"""What stands in place of the load, for one message and for several; by whether the place of the first is known."""


def load_text(looked: LookedAt, say: Words) -> str:
    """Return how long a text takes and how far it loads; why there is no curve where it cannot be run."""
    if looked.job is None:
        where = next((say(one.where) for one in looked.messages if one.line), "")
        return say.counted(len(looked.messages), *NO_CURVE[bool(where)], where=where)
    return say(
        "{time} min, peak torque {torque} N·m ({share} of rated)",
        time=clock(looked.duration_s),
        torque=f"{looked.peak_nm:.4g}",
        share=f"{100 * looked.peak_nm / looked.rated_nm:.0f} %",
    )


def chart_options(say: Words) -> Options:
    """Return the picture of a load, empty, with both axes."""
    axis = {
        "type": "value",
        "nameLocation": "middle",
        "nameTextStyle": {"fontSize": 14, "color": INK},
        "axisLabel": {"fontSize": 13, "color": INK},
        "splitLine": {"lineStyle": {"color": QUIET_INK}},
    }
    rated = {"silent": True, "symbol": "none", "label": {"formatter": say("rated")}, "data": []}
    rated |= {"lineStyle": {"color": INK}}
    line = {"type": "line", "data": [], "showSymbol": False, "lineStyle": {"width": 2, "color": LINE_INK}}
    return {
        "animation": False,
        "grid": {"left": 70, "right": 100, "top": 16, "bottom": 44},
        "xAxis": {**axis, "name": say("time from the first ramp in s"), "nameGap": 26},
        "yAxis": {**axis, "name": say("output torque in N·m"), "nameGap": 48},
        "series": [{**line, "markLine": rated}],
    }
