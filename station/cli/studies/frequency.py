"""`lostmotion study frequency`: compliance over frequency from a torque chirp, and the resonance in it."""

from __future__ import annotations

import csv
import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.studies.frequency_response import FrequencyResponse, fit_resonance, frequency_response
from analysis.trace.errors import AnalysisError
from station.cli.line.line_statistics import figure
from station.cli.out_file import refuse_records, writing
from station.cli.say import Grid, say
from station.cli.studies.loop_source import channels_of, trace_source
from station.errors import StationError


@dataclass(frozen=True)
class Asked:
    """What the command line asked for."""

    trace: str
    band: str
    period_s: float | None
    coherence: float
    recipe: str | None
    data: Path
    out: Path | None


def band_of(text: str) -> tuple[float, float]:
    """Return a band [Hz] of `LOW:HIGH`; StationError when it is none."""
    low, _, high = text.partition(":")
    try:
        band = float(low), float(high)
    except ValueError:
        band = math.nan, math.nan
    if not 0.0 < band[0] < band[1] < math.inf:
        raise StationError(f"--band: found {text!r}; allowed is LOW:HIGH in Hz, as in 5:120")
    return band


def frequency(asked: Asked, *, as_json: bool) -> int:
    """Print natural frequency, damping and dynamic stiffness; return 0.

    A response in which no resonance can be fitted is printed without it, with the reason.

    Raises:
        StationError, RecipeError, AnalysisError: bad input, or no line that passes the gate.

    """
    band = band_of(asked.band)
    if asked.out is not None:
        refuse_records(asked.out)
    source = trace_source(asked.trace, asked.recipe, asked.data)
    time_s = source.trace.channel("t_s", "the frequency response")
    angle, torque = channels_of(source)
    found = frequency_response(time_s, torque, angle, band, period_s=asked.period_s, least_coherence=asked.coherence)
    document = {
        "source": source.name,
        "virtual": source.virtual,
        "band_hz": list(band),
        "lines": found.frequency_hz.size,
        "lines_used": int(found.used.sum()),
        "averages": found.averages,
    }
    lines = f"{document['lines']} lines from {found.frequency_hz[0]:.4g} to {found.frequency_hz[-1]:.4g} Hz"
    gate = f"{document['lines_used']} pass the gate (coherence {asked.coherence:g})"
    blocks: list[str | Grid] = [f"{source.name}: {lines}, {gate}, {found.averages:.3g} averages"]
    try:
        one = fit_resonance(found)
    except AnalysisError as error:
        blocks.append(f"no resonance: {error}")
        document |= {"resonance": None, "reason": str(error)}
    else:
        stiffness = one.stiffness_nm_per_arcmin
        u_stiffness = stiffness * one.u_compliance_arcmin_per_nm / one.compliance_arcmin_per_nm
        rows = [
            ("natural frequency", figure(one.natural_frequency_hz, "Hz"), f"± {one.u_natural_frequency_hz:.2g}"),
            ("damping ratio", figure(one.damping_ratio, "", 4), f"± {one.u_damping_ratio:.2g}"),
            ("dynamic stiffness", figure(stiffness, "N·m/arcmin"), f"± {u_stiffness:.2g}"),
            ("inertia that this belongs to", figure(one.inertia_kg_m2, "kg·m²", 4), ""),
            ("delay of the angle", figure(1e3 * one.delay_s, "ms", 4), f"± {1e3 * one.u_delay_s:.2g}"),
        ]
        blocks.append(Grid(("", "", "standard u"), rows, right=(1,)))
        blocks.append(f"residual {one.residual:.3g} (1: the model fits within the noise) over {one.lines} lines")
        derived = {"stiffness_nm_per_arcmin": stiffness, "inertia_kg_m2": one.inertia_kg_m2}
        document |= {"resonance": dataclasses.asdict(one) | derived}
    if asked.out is not None:
        _write(asked.out, found)
        document |= {"written": str(asked.out)}
        blocks.append(f"lines   {asked.out}")
    return say(document, blocks, as_json=as_json)


def _write(path: Path, found: FrequencyResponse) -> None:
    head = ("frequency_hz", "magnitude_arcmin_per_nm", "phase_deg", "coherence", "u_relative", "used")
    columns = (
        found.frequency_hz,
        np.abs(found.response),
        np.degrees(np.angle(found.response)),
        found.coherence,
        found.u_relative,
        found.used.astype(np.float64),
    )
    with writing(path), path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(head)
        writer.writerows([f"{value:.9g}" for value in row] for row in zip(*columns, strict=True))
