"""Figures of the validity checks that ask how a trace was recorded: missed periods, old samples, saturated sensors.

Each returns a Reading, or the reason in words why the figure does not apply here.
"""

from __future__ import annotations

import math

from analysis.validity.evidence import Evidence, Figure, Reading

BENCH_WAITED = "the virtual bench waits for the controller: control cycles (scans) can be long, but none is missed"
NO_ZEROES = "not measured: the torque zeroes were not read again after the run"
LEAST_ZEROES = 10
"""Samples of a zero that is read again; fewer are none."""

TORQUE_WORDS = {"torque_in_nm": "input torque", "torque_out_nm": "output torque"}

NO_RECORD = "the trace was recorded elsewhere: its timing is not known"


def objections(evidence: Evidence) -> Reading | str:
    """Count what was said against the record itself."""
    return Reading(float(len(evidence.objections)), "; ".join(evidence.objections))


def missed_periods(evidence: Evidence) -> Reading | str:
    """Share of scan periods that were missed, %."""
    facts = evidence.facts
    if facts is None:
        return NO_RECORD
    if facts.bench_waited and not facts.missed:
        return BENCH_WAITED
    share = facts.missed / facts.periods if facts.periods else 0.0
    return Reading(share * 100.0, f"{facts.missed} of {facts.periods} scan periods were missed ({share:.3%})")


def sample_age(evidence: Evidence) -> Reading | str:
    """Age of the oldest sample, scans."""
    facts = evidence.facts
    if facts is None:
        return NO_RECORD
    return Reading(facts.oldest_sample_scans, f"a sample was {facts.oldest_sample_scans} scans old while measuring")


def torque_in_saturated(evidence: Evidence) -> Reading | str:
    """Count samples with the status bit."""
    return NO_RECORD if evidence.facts is None else Reading(evidence.facts.torque_in_saturated)


def torque_out_saturated(evidence: Evidence) -> Reading | str:
    """Count samples with the status bit."""
    return NO_RECORD if evidence.facts is None else Reading(evidence.facts.torque_out_saturated)


def not_ready(evidence: Evidence) -> Reading | str:
    """Count samples with the status bit."""
    return NO_RECORD if evidence.facts is None else Reading(evidence.facts.not_ready)


def torque_zeroes(evidence: Evidence) -> Reading | str:
    """Largest move of a torque zero in the run, of what the bench file declares of it, %."""
    facts = evidence.facts
    if facts is None:
        return NO_RECORD
    if facts.zeroes_again is None:
        return NO_ZEROES
    if facts.zeroes_again < LEAST_ZEROES:
        return Reading(
            math.inf,
            f"only {facts.zeroes_again} samples of the torque zeroes were taken after the run; expected {LEAST_ZEROES}",
        )
    worst = Reading(0.0)
    for name, (_, most_nm) in evidence.zero_moves_nm.items():
        moved_nm = facts.zero_shift_nm(name)
        if moved_nm is None or not math.isfinite(moved_nm):
            return Reading(math.inf, f"the {TORQUE_WORDS[name]} was not a number after the run")
        found = Reading(
            100.0 * abs(moved_nm) / most_nm if most_nm > 0.0 else math.inf if moved_nm else 0.0,
            f"the zero of the {TORQUE_WORDS[name]} changed by {moved_nm:+.3g} N·m in the run; the bench file allows "
            f"{most_nm:.3g} N·m",
        )
        worst = max(worst, found)
    return worst


FIGURES: dict[str, Figure] = {
    "record": objections,
    "missed_periods": missed_periods,
    "sample_age": sample_age,
    "torque_in_saturated": torque_in_saturated,
    "torque_out_saturated": torque_out_saturated,
    "not_ready": not_ready,
    "torque_zeroes": torque_zeroes,
}
"""Figures of these checks, by their ids."""
