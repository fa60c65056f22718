"""`lostmotion model`: a reducer as a model, for whoever simulates its robot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.models.identify import MOST_CORRELATION, Identified, Refusal, identify
from analysis.models.maxwell_slip import EQUATIONS, identify_maxwell_slip, parameter_units
from analysis.models.reducer_model import model_to_json
from analysis.models.samples import LoopSamples
from analysis.models.table import MODELS
from analysis.trace.errors import AnalysisError
from station.cli.out_file import refuse_records, writing
from station.cli.say import Grid, say
from station.cli.studies.loop_source import Source, loop_of, loop_source
from station.documents.entries import alongside, left_out
from station.errors import StationError
from station.reports.result_text import minus

KINDS = {"cubic": "cubic", "dahl": "gap_dahl", "bouc-wen": "bouc_wen", "maxwell-slip": "maxwell_slip"}
"""Kinds as they are asked for, and the models' names in the export."""

ALL = "all"
SHOWN_CORRELATION = 0.8
"""Pairs of parameters that hang together by this much are named."""


@dataclass(frozen=True)
class Asked:
    """What the command line asked for."""

    trace: str
    kind: str
    fixed: Sequence[str]
    recipe: str | None
    bench: str | None
    data: Path
    out: Path | None


def model(asked: Asked, *, as_json: bool) -> int:
    """Identify one model, or compare all of them; return 0.

    Raises:
        StationError, RecipeError, AnalysisError: bad input, a fit that does not end, or an export of a parameter that
            the loop does not determine.

    """
    kind = asked.kind.replace("_", "-")
    kind = "dahl" if kind == "gap-dahl" else kind
    if kind != ALL and kind not in KINDS:
        raise StationError(f"--kind (kind of model): found {asked.kind!r}; allowed are {', '.join(KINDS)}, {ALL}")
    fixed = fixed_values(asked.fixed)
    if kind == ALL and (fixed or asked.out is not None):
        raise StationError("--fix and --out are for one model: name it with --kind")
    if kind == "maxwell-slip" and fixed:
        raise StationError("--fix: maxwell-slip has no parameters to fix; leave it out")
    if asked.out is not None:
        refuse_records(asked.out)
    source = loop_source(asked.trace, asked.recipe, asked.bench, asked.data)
    loop = loop_of(source)
    if kind == ALL:
        return _compare(source, loop, as_json=as_json)
    found = _identified(kind, loop, fixed)
    document = OneModel(loop=_from_loop(source), found=described(found))
    blocks = _blocks(source, kind, found)
    if asked.out is not None:
        with writing(asked.out):
            asked.out.write_text(model_to_json(found, source.serial), encoding="utf-8")
        document = replace(document, exported=str(asked.out))
        blocks.append(
            f"model written to {asked.out}. To calculate torques with it: lostmotion play-model {asked.out} ANGLES.csv"
        )
    return say(document, blocks, as_json=as_json)


def fixed_values(texts: Sequence[str]) -> dict[str, float]:
    """Return the values of `--fix NAME=VALUE`; StationError for what is no such thing."""
    values = {}
    for text in texts:
        name, equals, number = text.partition("=")
        try:
            value = float(number)
        except ValueError:
            value = math.nan
        if not equals or not math.isfinite(value):
            raise StationError(
                f"--fix: found {text!r}; allowed is NAME=VALUE with a finite number, as in friction_nm=23"
            )
        values[name.strip()] = value
    return values


def _identified(kind: str, loop: LoopSamples, fixed: Mapping[str, float]) -> Identified:
    return identify_maxwell_slip(loop) if kind == "maxwell-slip" else identify(loop, KINDS[kind], fixed)


@dataclass(frozen=True)
class ParameterFound:
    """A parameter of a model: what was found, how sure it is, and what it means."""

    name: str
    value: float
    unit: str
    standard_uncertainty: float
    text: str


@dataclass(frozen=True)
class Correlation:
    """Correlation of the parameters that were free, in their order."""

    of: Sequence[str]
    matrix: list[list[float]]


@dataclass(frozen=True)
class ModelFound:
    """A fit: every parameter with unit, meaning and uncertainty, and what the loop does not determine."""

    model: str
    equations: str
    parameters: tuple[ParameterFound, ...]
    residual_pct_of_peak: float
    worst_residual_pct_of_peak: float
    peak_nm: float
    samples: int
    correlation: Correlation
    refused: Sequence[Refusal]
    at_bound: Sequence[str]
    friction_at_turns: Sequence[float]
    exportable: bool


@dataclass(frozen=True)
class FromLoop:
    """Which loop a model was fitted to."""

    source: str
    serial: str
    virtual: bool


@dataclass(frozen=True, kw_only=True)
class OneModel:
    """What `model --json` prints of one model."""

    loop: FromLoop = alongside()
    found: ModelFound = alongside()
    exported: str | None = left_out()


@dataclass(frozen=True, kw_only=True)
class AllModels:
    """What `model --kind all --json` prints: every fit that ended, and why others did not."""

    loop: FromLoop = alongside()
    models: tuple[ModelFound, ...]
    failed: Mapping[str, str]


def described(found: Identified) -> ModelFound:
    """Return what is told of a fit."""
    row = MODELS.get(found.model)
    units = parameter_units(found.values) if row is None else {name: one.unit for name, one in row.parameters.items()}
    texts = {} if row is None else {name: one.text for name, one in row.parameters.items()}
    return ModelFound(
        model=found.model,
        equations=EQUATIONS if row is None else row.equations,
        parameters=tuple(
            ParameterFound(name, value, units[name], found.u[name], texts.get(name, ""))
            for name, value in found.values.items()
        ),
        residual_pct_of_peak=found.residual_pct,
        worst_residual_pct_of_peak=found.worst_pct,
        peak_nm=found.peak_nm,
        samples=found.samples,
        correlation=Correlation(found.free, found.correlation.tolist()),
        refused=found.refused,
        at_bound=found.at_bound,
        friction_at_turns=found.friction_at_turns,
        exportable=row is None or not found.refused,
    )


def _compare(source: Source, loop: LoopSamples, *, as_json: bool) -> int:
    found: dict[str, Identified] = {}
    failed: dict[str, str] = {}
    for kind in KINDS:
        try:
            found[kind] = _identified(kind, loop, {})
        except AnalysisError as error:
            failed[kind] = str(error)
    rows = [
        (kind, f"{one.residual_pct:.3f} %", f"{one.worst_pct:.2f} %", str(len(one.values)), _exportable(one))
        for kind, one in found.items()
    ]
    rows += [(kind, "–", "–", "", f"no: {reason}") for kind, reason in failed.items()]
    grid = Grid(("model", "residual rms", "largest", "parameters", "can be exported"), rows, right=(1, 2, 3))
    last = "Residuals are of the peak torque. The parameters of one model: --kind NAME"
    models = tuple(described(one) for one in found.values())
    document = AllModels(loop=_from_loop(source), models=models, failed=failed)
    return say(document, [_head(source, loop.peak_nm), grid, last], as_json=as_json)


def _from_loop(source: Source) -> FromLoop:
    return FromLoop(source.name, source.serial, source.virtual)


def _exportable(found: Identified) -> str:
    if found.model == KINDS["maxwell-slip"] or not found.refused:
        return "yes"
    return f"no: {found.refused[0].parameter} {found.refused[0].reason}"


def _head(source: Source, peak_nm: float) -> str:
    badge = "   VIRTUAL BENCH" if source.virtual else ""
    return f"{source.serial or source.name}: loop with a peak torque of {peak_nm:.4g} N·m{badge}"


def _blocks(source: Source, kind: str, found: Identified) -> list[str | Grid]:
    document = described(found)
    refused = {refusal.parameter for refusal in found.refused}
    rows = [
        (
            one.name,
            _rounded(one.value, one.standard_uncertainty),
            _spread_text(found, one.name, refused),
            one.unit if one.unit != "1" else "",
            one.text,
        )
        for one in document.parameters
    ]
    blocks: list[str | Grid] = [
        f"{_head(source, found.peak_nm)}, model {kind}: {document.equations}",
        Grid(("parameter", "value", "standard u", "unit", ""), rows, right=(1,)),
        f"residual {found.residual_pct:.3f} % of the peak torque (rms), {found.worst_pct:.2f} % at most",
    ]
    if found.friction_at_turns and not found.refused:
        falling, rising = found.friction_at_turns
        blocks.append(
            f"friction at the turning points: {falling:.0%} where the torque starts to fall, "
            f"{rising:.0%} where it starts to rise"
        )
    for refusal in found.refused:
        where = "merged " if kind == "maxwell-slip" else "NOT DETERMINED "
        blocks.append(f"{where}{refusal.parameter}: {refusal.reason}")
    blocks += [f"AT ITS BOUND {name}: the parameter reached its limit" for name in found.at_bound]
    pairs = _pairs(found)
    if pairs:
        blocks.append(
            f"correlations of parameters above {SHOWN_CORRELATION:g} (not accepted above {MOST_CORRELATION:g}): {pairs}"
        )
    if refused and kind != "maxwell-slip":
        blocks.append(
            "This model cannot be exported: give a known value with --fix NAME=VALUE, or load the unit to a higher "
            "torque"
        )
    return blocks


def _pairs(found: Identified) -> str:
    names, matrix = found.free, found.correlation
    return ", ".join(
        minus(f"{left} and {names[right]} {matrix[place, right]:+.2f}")
        for place, left in enumerate(names)
        for right in range(place + 1, len(names))
        if abs(matrix[place, right]) > SHOWN_CORRELATION
    )


def _rounded(value: float, spread: float) -> str:
    if math.isfinite(spread) and 0.0 < spread < abs(value):
        decimals = min(max(1 - math.floor(math.log10(spread)), 0), 9)
        return minus(f"{value:.{decimals}f}")
    return minus(f"{value:.5g}")


def _spread_text(found: Identified, name: str, refused: set[str]) -> str:
    if name in refused:
        return "not determined"
    if name in found.at_bound:
        return "at its bound"
    spread = found.u[name]
    return "given" if spread == 0.0 else f"± {spread:.2g}" if math.isfinite(spread) else "no influence"
