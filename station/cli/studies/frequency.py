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
from analysis.trace.units import FloatArray
from definitions.program import Sweep
from station.cli.line.line_statistics import figure
from station.cli.out_file import refuse_records, writing
from station.cli.say import Grid, say
from station.cli.studies.loop_source import Source, channels_of, trace_source
from station.errors import StationError


@dataclass(frozen=True)
class Asked:
    """What the command line asked for."""

    trace: str
    band: str | None
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
        StationError, RecipeError, AnalysisError: bad input, or no line whose coherence passes.

    """
    if asked.out is not None:
        refuse_records(asked.out)
    source = trace_source(asked.trace, asked.recipe, asked.data)
    band, period_s = _band_and_period(asked, source)
    time_s = source.trace.channel("t_s", "the frequency response")
    angle, torque = channels_of(source)
    swing: Swing | None = None
    if source.sweep is not None:
        swept = _swept_rows(source)
        time_s, angle, torque = time_s[swept], angle[swept], torque[swept]
        swing = Swing.of(torque, *source.sweep)
    found = frequency_response(time_s, torque, angle, band, period_s=period_s, least_coherence=asked.coherence)
    document = {
        "source": source.name,
        "virtual": source.virtual,
        "band_hz": list(band),
        "lines": found.frequency_hz.size,
        "lines_used": int(found.used.sum()),
        "averages": found.averages,
        "response": _response(found),
        "amplitude": None if swing is None else dataclasses.asdict(swing),
    }
    lines = f"{document['lines']} lines from {found.frequency_hz[0]:.4g} to {found.frequency_hz[-1]:.4g} Hz"
    gate = f"{document['lines_used']} have enough coherence (at least {asked.coherence:g})"
    blocks: list[str | Grid] = [f"{source.name}: {lines}, {gate}, {found.averages:.3g} averages", _stiffness(found)]
    if swing is not None:
        blocks.append(swing.text)
    try:
        one = fit_resonance(found)
    except AnalysisError as error:
        blocks.append(str(error))
        document |= {"resonance": None, "reason": str(error)}
    else:
        stiffness = one.stiffness_nm_per_arcmin
        u_stiffness = stiffness * one.u_compliance_arcmin_per_nm / one.compliance_arcmin_per_nm
        rows = [
            ("natural frequency", figure(one.natural_frequency_hz, "Hz"), f"± {one.u_natural_frequency_hz:.2g}"),
            ("damping ratio", figure(one.damping_ratio, "", 4), f"± {one.u_damping_ratio:.2g}"),
            ("dynamic stiffness", figure(stiffness, "N·m/arcmin"), f"± {u_stiffness:.2g}"),
            ("inertia for this frequency", figure(one.inertia_kg_m2, "kg·m²", 4), ""),
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


def _band_and_period(asked: Asked, source: Source) -> tuple[tuple[float, float], float | None]:
    """Return the band [Hz] and the period [s]: those asked for, or of the run's own sweep."""
    if source.sweep is None:
        if asked.band is None:
            raise StationError(
                f"{source.name}: found no step torque_sweep, so the band is not known; name the band of the chirp with "
                "--band LOW:HIGH"
            )
        return band_of(asked.band), asked.period_s
    if asked.period_s is not None:
        raise StationError("--period is for files; a stored run has the period of its sweep. Leave out --period")
    sweep, scan_s = source.sweep
    period_s = sweep.period_scans * scan_s
    half_line_hz = 0.5 / period_s  # the first and the last line lie on the ends of the band
    own = (sweep.from_hz - half_line_hz, sweep.to_hz + half_line_hz)
    return own if asked.band is None else band_of(asked.band), period_s


def _swept_rows(source: Source) -> slice:
    """Return the rows of a run's sweep without its last period, in which the amplitude fades.

    Raises:
        StationError: rows are missing, or the sweep was held up: its periods are then not alike.

    """
    trace = source.trace
    if source.sweep is None or trace.segment is None:
        raise StationError(
            f"{source.name}: the record does not say which samples belong to the sweep. Name another run"
        )
    sweep, _ = source.sweep
    swept = [key for key, info in trace.segments.items() if info.role == "sweep"]
    rows = np.flatnonzero(np.isin(trace.segment, swept))
    if abs(rows.size - sweep.scans) > 1:
        raise StationError(
            f"{source.name}: the sweep has {rows.size} samples, {sweep.scans} were planned: the sweep was held up or "
            "stopped, "
            "or samples are missing. Measure again"
        )
    return slice(int(rows[0]), int(rows[0]) + sweep.scans - sweep.period_scans)


FOLLOWED = 0.1
"""Share of the planned amplitude by which the torque may miss it: a reducer's stiffness depends on the amplitude."""


@dataclass(frozen=True)
class Swing:
    """Amplitude of the torque in a sweep [N·m]: planned, and reached at the lowest and the highest frequency [Hz]."""

    planned_nm: float
    from_hz: float
    reached_at_from_hz_nm: float
    to_hz: float
    reached_at_to_hz_nm: float

    @classmethod
    def of(cls, torque_nm: FloatArray, sweep: Sweep, scan_s: float) -> Swing:
        """Return what the output torque [N·m] of a sweep without its last period reached; the first one is left out."""
        lowest = range(sweep.period_scans, torque_nm.size, sweep.period_scans)
        highest = range(sweep.period_scans + sweep.period_scans // 2, torque_nm.size, sweep.period_scans)
        slow, fast = (
            float(np.mean([_half_of_swing(torque_nm, place, hz * scan_s) for place in places]))
            for places, hz in ((lowest, sweep.from_hz), (highest, sweep.to_hz))
        )
        return cls(sweep.amplitude_nm, sweep.from_hz, slow, sweep.to_hz, fast)

    @property
    def followed(self) -> bool:
        """True where the torque had the planned amplitude at both ends of the band."""
        reached = (self.reached_at_from_hz_nm, self.reached_at_to_hz_nm)
        return all(abs(one - self.planned_nm) <= FOLLOWED * self.planned_nm for one in reached)

    @property
    def text(self) -> str:
        """One line on the amplitude, with what to do where the drive did not follow."""
        found = (
            f"amplitude of the torque: {figure(self.planned_nm, 'N·m')} planned, "
            f"{figure(self.reached_at_from_hz_nm, 'N·m')} at {self.from_hz:.4g} Hz, "
            f"{figure(self.reached_at_to_hz_nm, 'N·m')} at {self.to_hz:.4g} Hz"
        )
        if self.followed:
            return found
        return (
            f"{found}. Warning: the drive did not reach the planned amplitude, so the response is valid for the "
            "smaller amplitude only. Lower to_frequency or the amplitude, or tune the torque loop"
        )


def _half_of_swing(torque_nm: FloatArray, place: int, cycles_per_scan: float) -> float:
    """Half of what the torque spans within one cycle about a place."""
    half = round(0.5 / cycles_per_scan)
    return float(np.ptp(torque_nm[max(place - half, 0) : place + half])) / 2.0


def _response(found: FrequencyResponse) -> list[dict[str, float | bool]]:
    """Return every line with what it says of the dynamic stiffness, for JSON."""
    rows: list[dict[str, float | bool]] = []
    for line, frequency_hz in enumerate(found.frequency_hz.tolist()):
        magnitude = float(abs(found.response[line]))
        if magnitude > 0.0:
            stiffness = 1.0 / magnitude
            rows.append(
                {
                    "frequency_hz": frequency_hz,
                    "stiffness_nm_per_arcmin": stiffness,
                    "u_stiffness_nm_per_arcmin": stiffness * float(found.u_relative[line]),
                    "phase_deg": math.degrees(np.angle(found.response[line])),
                    "coherence": float(found.coherence[line]),
                    "used": bool(found.used[line]),
                }
            )
    return rows


SHOWN_LINES = 9
"""Lines of the response that are shown; `--out` writes all of them."""


def _stiffness(found: FrequencyResponse) -> Grid:
    """Return the dynamic stiffness over frequency, of some of the lines whose coherence passes."""
    used = [row for row in _response(found) if row["used"]]
    shown = np.unique(np.linspace(0, len(used) - 1, SHOWN_LINES).round().astype(np.int64)).tolist()
    rows = [
        (
            figure(row["frequency_hz"], "Hz", 4),
            figure(row["stiffness_nm_per_arcmin"], "N·m/arcmin", 4),
            f"± {row['u_stiffness_nm_per_arcmin']:.2g}",
            f"{row['phase_deg']:+.1f}°".replace("-", "−"),
            f"{row['coherence']:.4f}",
        )
        for row in (used[place] for place in shown)
    ]
    return Grid(("frequency", "dynamic stiffness", "standard u", "phase", "coherence"), rows, right=(0, 1, 3, 4))


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
