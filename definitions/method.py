"""How a trace is evaluated: what a recipe and the analysis both call by these names, and figures that both go by."""

from __future__ import annotations

from typing import Literal

Loading = Literal["input", "output"]
"""Shaft that the servo drives; the other one is locked."""

OutputTorque = Literal["reaction", "calibrated"]
"""Torque at the output: as measured there, or converted from the input torque."""

DecisionRule = Literal["simple", "guard_band"]
"""The value is judged by the limits as they are, or by limits moved by w = r·U."""

LeftOpenErrors = Literal["told", "budget"]
"""Errors that the checks of a run leave open: told beside the verdict, or contributions to every U that they move."""

ONE_SIDED_95 = 1.645 / 2.0
"""Guard factor r of w = r·U for 95 % one-sided confidence when U is expanded with k = 2 (JCGM 106)."""

LEAST_USUAL_GUARD = 0.82
"""`ONE_SIDED_95` as people write it; what a smaller guard factor decides within U is told beside the verdict."""

DIFFERENT_SPEED = 1.2
"""Fastest over slowest cycle from which the delay between torque and angle is estimated."""
