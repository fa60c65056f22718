"""Friction of the input side against the catalogue's: a note beside the verdict where nothing else can tell.

The offset of the loading line is the friction of the input side as output torque. A hysteresis of the output torque
sensor is in that offset too, and makes the loop narrower or wider by as much: 9 N·m of it read a backlash of
1.14 arcmin as 0.93. No check can tell it from a unit with other friction, for units differ; who knows them can.
"""

from __future__ import annotations

import math

from analysis.torque_ratio.quadrants import Quadrants

APART = 1.0 / 3.0
"""Share of the catalogue's friction by which that of a unit may differ unsaid."""


def friction_offset_note(ratio: Quadrants | None, catalogue_nm: float | None) -> str:
    """Say that the friction of the input side is not the catalogue's; '' where it is, or is not known.

    catalogue_nm: offset of the loading line, below zero [N·m].
    """
    if ratio is None or catalogue_nm is None or not ratio.fits:
        return ""
    found_nm = (ratio.load_positive.offset_nm - ratio.load_negative.offset_nm) / 2.0
    expanded_nm = math.hypot(*(ratio.fits[name].u_offset_nm for name in ("load_positive", "load_negative")))
    apart_nm = found_nm - catalogue_nm
    if abs(apart_nm) <= APART * abs(catalogue_nm) + expanded_nm:
        return ""
    return (
        f"friction of the input side is {found_nm:.3g} N·m at the output, and {catalogue_nm:.3g} N·m by the catalogue: "
        "the friction of this unit differs, or the output torque sensor has hysteresis, which adds to every backlash "
        "and loop width. Measure the master part"
    )
