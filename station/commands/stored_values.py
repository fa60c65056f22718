"""One metric over many stored runs: which runs count, which were left out and why, and that they are comparable."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from station.errors import RecordError, StationError
from station.record.run_record import RESULT, RunRecord
from station.record.seal import alterations
from station.record.store import Store
from station.reports.headline import virtual_badges
from station.run.recovery import recover_all

ATTEMPTS = ("first", "last", "all")
"""Which runs of a serial number count: a retest must not count twice where each unit counts once."""

SAME = ("unit", "definition", "branch", "estimator", "band", "torque_nm")
"""What must be the same of a metric in every run, or the numbers are not of one kind."""


MEASURED, CONVERTED = "output torque as measured", "output torque converted from the input's"


class Kind(NamedTuple):
    """What a run was measured by: recipe, its revision, where the output torque comes from ('' where no stage says)."""

    recipe: str
    revision: int
    torque: str


@dataclass(frozen=True)
class Ask:
    """Which values are meant: metric, and what tells it from others of its id; None takes what there is.

    metric: an id, followed by what was chosen otherwise than its definition does: `spring_constant three_region`.
    """

    metric: str
    side: str | None = None
    branch: str | None = None
    recipe: str | None = None
    serial: str | None = None
    attempts: str = "all"


def asked_of(
    metric: str | None,
    side: str | None = None,
    branch: str | None = None,
    recipe: str | None = None,
    serial: str | None = None,
    *,
    attempts: str = "all",
) -> Ask | None:
    """Return what a command line asks of the stored runs; None without a metric: a file is meant."""
    return None if metric is None else Ask(metric, side, branch, recipe, serial, attempts)


@dataclass(frozen=True)
class StoredValue:
    """One run's value of a metric, with the run it came from; operator: '' where the run has none."""

    run: RunRecord
    serial: str
    started: datetime
    bench: str
    value: float
    virtual: bool
    operator: str = ""
    faults: bool = False


@dataclass(frozen=True)
class StoredValues:
    """Values of one metric in order of time, its limits in the newest run, and what was left out (reason, count)."""

    ask: Ask
    unit: str
    name: str
    definition: str
    limits: dict[str, float | None]
    values: list[StoredValue]
    left_out: Counter[str] = field(default_factory=Counter)
    kinds: Counter[Kind] = field(default_factory=Counter)

    def notes(self) -> list[str]:
        """Return what a reader must know of the runs behind the figures."""
        virtual = sum(one.virtual for one in self.values)
        notes = [f"VIRTUAL: {virtual} of {len(self.values)} runs are of the virtual bench"] if virtual else []
        faults = sum(one.faults for one in self.values)
        notes += [f"FAULTS INJECTED: in {faults} of {len(self.values)} runs"] if faults else []
        for what in ("revision", "torque"):
            counts = _counts(self.kinds, what)
            notes += [f"MIXED: {_listing(counts, what)}"] if len(counts) > 1 else []
        return notes + [f"left out: {count} {reason}" for reason, count in self.left_out.items()]

    def head(self) -> dict[str, Any]:
        """Return what was taken, for JSON."""
        return {
            "metric": self.ask.metric,
            "definition": self.definition,
            "unit": self.unit,
            "side": self.ask.side,
            "recipe": self.ask.recipe,
            "runs": [one.run.id for one in self.values],
            "left_out": dict(self.left_out),
            "virtual_runs": sum(one.virtual for one in self.values),
            "runs_with_faults": sum(one.faults for one in self.values),
        }


def stored_values(data: Path, ask: Ask, only: Collection[str] | None = None) -> StoredValues:
    """Collect one metric over the complete, unaltered runs of a data folder.

    only: ids of the runs that are asked for; None: all.

    Raises:
        StationError: no such folder, no value at all (with what was left out), a metric that stands in a run more than
            once, runs whose definitions of the metric differ, or, while no recipe is asked for, runs of several
            recipes or with the output torque from different sensors.

    """
    if not data.is_dir():
        raise StationError(f"--data {data}: there is no such folder; name the one that 'lostmotion run' wrote to")
    if ask.attempts not in ATTEMPTS:
        raise StationError(f"--attempts: found {ask.attempts!r}; allowed are {', '.join(ATTEMPTS)}")
    store = Store(data)
    recover_all(store)
    left_out: Counter[str] = Counter()
    rows: list[tuple[StoredValue, dict[str, Any]]] = []
    kinds: dict[str, Kind] = {}
    for run in store.runs():
        found = _read(run, ask, left_out, kinds) if only is None or run.id in only else None
        if found is not None:
            rows.append(found)
    rows = _attempts(rows, ask.attempts, left_out)
    if not rows:
        what = ", ".join(f"{count} {reason}" for reason, count in left_out.items()) or "it holds no runs"
        raise StationError(f"{data}: no run has a value of {ask.metric}: {what}. See 'lostmotion list'")
    metric = _same(rows)
    pooled = Counter(kinds[value.run.id] for value, _ in rows)
    if ask.recipe is None:
        _check_one_kind(ask.metric, pooled)
    side = ask.side or str(metric["side"])
    name = ask.metric if side == "both" else f"{ask.metric} side {side.replace('-', '−')}"
    values = [value for value, _ in rows]
    limits = rows[-1][1]["limits"]
    return StoredValues(ask, metric["unit"], name, metric["definition"], limits, values, left_out, pooled)


def _read(
    run: RunRecord, ask: Ask, left_out: Counter[str], kinds: dict[str, Kind]
) -> tuple[StoredValue, dict[str, Any]] | None:
    """Return a run's value and its metric, and note its kind by its id.

    None counts why it was left out (not for runs that were not asked for).
    """
    try:
        manifest = run.manifest()
        asked = ask.recipe in (None, manifest["recipe"]["name"]) and ask.serial in (None, manifest["serial"])
        if not asked:
            return None
        reason, result = _usable(run, manifest)
        metric = None if result is None else _metric(run, result, ask)
        value = None if metric is None else _value(metric, ask)
        if result is None or metric is None or value is None:
            missing = f"without {ask.metric}" if metric is None else "whose value could not be evaluated"
            left_out[reason or missing] += 1
            return None
        kinds[run.id] = _kind(manifest, result)
        started = datetime.fromisoformat(manifest["started"])
        bench = str((result.get("bench") or {}).get("name", ""))
        who, virtual = str(manifest.get("operator") or ""), bool(virtual_badges(result))
        faults = bool(manifest.get("scenario"))
        return StoredValue(run, manifest["serial"], started, bench, value, virtual, who, faults), metric
    except (RecordError, KeyError, TypeError, ValueError, AttributeError):
        left_out["damaged"] += 1
        return None


def _kind(manifest: dict[str, Any], result: dict[str, Any]) -> Kind:
    torque = next((stage for stage in result.get("stages") or () if stage.get("stage") == "output torque"), None)
    source = "" if torque is None else CONVERTED if torque["applied"] else MEASURED
    return Kind(str(manifest["recipe"]["name"]), int(manifest["recipe"]["revision"]), source)


def _counts(kinds: Counter[Kind], what: str) -> Counter[Any]:
    """Count the runs by one field of their kind; those where nothing is known of it are not counted."""
    found: Counter[Any] = Counter()
    for kind, count in kinds.items():
        if getattr(kind, what) != "":
            found[getattr(kind, what)] += count
    return found


def _listing(counts: Counter[Any], what: str) -> str:
    named = "" if what == "torque" else f"{what} "
    return ", ".join(f"{count} {'run' if count == 1 else 'runs'} of {named}{key}" for key, count in counts.items())


def _check_one_kind(metric: str, kinds: Counter[Kind]) -> None:
    """Refuse runs whose spread is that of the recipes or of the torque sensors, and not of what was measured."""
    recipes, torques = _counts(kinds, "recipe"), _counts(kinds, "torque")
    if len(recipes) > 1:
        raise StationError(
            f"{metric}: found {_listing(recipes, 'recipe')}; only runs of one recipe are comparable. Choose it with "
            "--recipe NAME"
        )
    if len(torques) > 1:
        raise StationError(
            f"{metric}: found {_listing(torques, 'torque')}; their errors are different ones. Keep them in data "
            f"folders of their own, or take them together all the same with --recipe {next(iter(recipes))}"
        )


def _usable(run: RunRecord, manifest: dict[str, Any]) -> tuple[str, dict[str, Any] | None]:
    if manifest["state"] != "complete":
        return f"that ended as {run.state()}", None
    if alterations(run, samples=False):
        return "altered", None
    result: dict[str, Any] = run.read_json(RESULT)
    if any(str(reason).startswith("measurement invalid") for reason in result["reasons"]):
        return "whose measurement was invalid", None
    return "", result


def _metric(run: RunRecord, result: dict[str, Any], ask: Ask) -> dict[str, Any] | None:
    """Return the metric that is asked for; of several with its id, the one with no other choices than asked for."""
    name, *words = ask.metric.split() or [""]
    of_id: list[dict[str, Any]] = [
        one for one in result["metrics"] if one["id"] == name and ask.branch in (None, one["branch"])
    ]
    found = [one for one in of_id if set(words) <= _choices(one)]
    exact = [one for one in found if set(words) == _choices(one)]
    if len(found) > 1 and len(exact) != 1:
        there = ", ".join(" ".join([name, *one.get("choices", []), f"({one['branch']})"]) for one in found)
        raise StationError(
            f"--metric: {ask.metric} stands {len(found)} times in run {run.id}: {there}. Choose with --branch, or name "
            "the choice with the metric in quotes"
        )
    chosen = exact or found
    return chosen[0] if chosen else None


def _choices(metric: dict[str, Any]) -> set[str]:
    return set(" ".join(metric.get("choices", [])).split())


def _value(metric: dict[str, Any], ask: Ask) -> float | None:
    if ask.side is None or ask.side == metric["side"]:
        value = metric["value"]
    else:
        sides = metric.get("sides") or {}
        if ask.side not in sides:
            raise StationError(f"--side: found {ask.side!r}; {ask.metric} has {', '.join(sides) or metric['side']}")
        value = sides[ask.side]["value"]
    return None if value is None else float(value)


def _attempts(rows: list[tuple[StoredValue, Any]], which: str, left_out: Counter[str]) -> list[tuple[StoredValue, Any]]:
    if which == "all":
        return rows
    kept: dict[str, tuple[StoredValue, Any]] = {}
    for row in rows:
        if which == "last" or row[0].serial not in kept:
            kept[row[0].serial] = row
    if len(rows) > len(kept):
        left_out[f"that are not the {which} of their unit"] += len(rows) - len(kept)
    return sorted(kept.values(), key=lambda row: row[0].run.id)


def _same(rows: list[tuple[StoredValue, dict[str, Any]]]) -> dict[str, Any]:
    """Return the metric of the newest run; StationError when another run means something else by it."""
    newest, metric = rows[-1]
    for value, other in rows:
        differs = [key for key in SAME if other.get(key) != metric.get(key)]
        if differs:
            raise StationError(
                f"runs {value.run.id} and {newest.run.id} mean different things by {metric['id']}: {differs[0]} is "
                f"{other.get(differs[0])!r} and {metric.get(differs[0])!r}. Choose runs of one recipe with --recipe"
            )
    return metric
