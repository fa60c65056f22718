"""One metric of one stored run: whether the run counts, which of its metrics is meant, its value and its kind."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, NamedTuple

from station.errors import RecordError, StationError
from station.record.run_record import RESULT, RunRecord
from station.record.seal import alterations
from station.reports.headline import virtual_badges

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


class StoredMetric(NamedTuple):
    """What a run that counts has of the metric: its value, the metric as its result holds it, the kind of the run."""

    value: StoredValue
    metric: dict[str, Any]
    kind: Kind


def read_metric(run: RunRecord, ask: Ask) -> StoredMetric | str | None:
    """Return what a run has of the metric; why it is left out, in words; None for a run that was not asked for.

    Raises:
        StationError: the metric stands in the run more than once, or has no such side.

    """
    try:
        manifest = run.manifest()
        asked = ask.recipe in (None, manifest["recipe"]["name"]) and ask.serial in (None, manifest["serial"])
        if not asked:
            return None
        reason, result = _usable(run, manifest)
        if result is None:
            return reason
        metric = _metric(run, result, ask)
        value = None if metric is None else _value(metric, ask)
        if metric is None or value is None:
            return f"without {ask.metric}" if metric is None else "whose value could not be evaluated"
        kind = _kind(manifest, result)
        started = datetime.fromisoformat(manifest["started"])
        bench = str((result.get("bench") or {}).get("name", ""))
        who, virtual = str(manifest.get("operator") or ""), bool(virtual_badges(result))
        faults = bool(manifest.get("scenario"))
        found = StoredValue(run, manifest["serial"], started, bench, value, virtual, who, faults)
    except (RecordError, KeyError, TypeError, ValueError, AttributeError):
        return "damaged"
    return StoredMetric(found, metric, kind)


def objection(result: Mapping[str, Any]) -> str:
    """Return why a result's measurement was invalid, in its own words; '' where it was not."""
    said = (str(reason) for reason in result["reasons"])
    return next((reason for reason in said if reason.startswith("measurement invalid")), "")


def _kind(manifest: dict[str, Any], result: dict[str, Any]) -> Kind:
    torque = next((stage for stage in result.get("stages") or () if stage.get("stage") == "output torque"), None)
    source = "" if torque is None else CONVERTED if torque["applied"] else MEASURED
    return Kind(str(manifest["recipe"]["name"]), int(manifest["recipe"]["revision"]), source)


def _usable(run: RunRecord, manifest: dict[str, Any]) -> tuple[str, dict[str, Any] | None]:
    if manifest["state"] != "complete":
        return f"that ended as {run.state()}", None
    if alterations(run, samples=False):
        return "altered", None
    result: dict[str, Any] = run.read_json(RESULT)
    if objection(result):
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
