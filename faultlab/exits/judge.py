"""What came of an exit: how soon the torque was low, how high it still went, and what became of the lock."""

from __future__ import annotations

from dataclasses import dataclass

from faultlab.exits.rows import RATED_NM, Exit
from faultlab.matrix.matrix import LOW_SHARE_OF_RATED
from faultlab.rows import REST_SHARE_OF_RATED
from faultlab.run import FaultRun


@dataclass(frozen=True)
class Measured:
    """What came of an exit. `low_s`: until the torque stays below 2 % of rated, None when friction keeps a rest.

    `down_s`: until it stays below what friction may keep. `begin_state` and `begin_nm`: state and torque at the cause,
    `peak_nm`: largest torque from there on. `opened_nm`: torque at which the lock was ordered open, None when it was
    not. `closed`: the lock is ordered closed at the end. `by`: what provoked it.
    """

    id: str
    begin_state: str
    state: str
    low_s: float | None
    down_s: float | None
    begin_nm: float
    peak_nm: float
    rest_nm: float
    opened_nm: float | None
    closed: bool
    by: str
    wrong: tuple[str, ...]


def _below(torque_nm: list[float], share: float, period_s: float) -> float | None:
    """Time from the first value until the torque stays below a share of rated torque; None when it never does."""
    limit_nm = share * RATED_NM
    last = next((at for at in range(len(torque_nm) - 1, -1, -1) if abs(torque_nm[at]) >= limit_nm), -1)
    return None if last == len(torque_nm) - 1 else (last + 1) * period_s


def judge_exit(row: Exit, run: FaultRun, begin: int, by: str, *, began: str, ended: str) -> Measured:
    """Measure a run from its place `begin` on, where it was in the state `began`; it ended in the state `ended`."""
    torque_nm = run.torque_nm[begin:]
    low_s, down_s = (_below(torque_nm, share, run.period_s) for share in (LOW_SHARE_OF_RATED, REST_SHARE_OF_RATED))
    opened = next(
        (at for at in range(max(begin, 1), len(run.orders)) if run.orders[at - 1].brake_on > run.orders[at].brake_on),
        None,
    )
    opened_nm = None if opened is None else abs(run.torque_nm[opened])
    wrong = []
    if down_s is None or down_s > row.bound_s:
        wrong.append(f"torque was removed after {down_s} s, allowed {row.bound_s:g} s")
    if row.lock == "opened" and (opened_nm is None or opened_nm > LOW_SHARE_OF_RATED * RATED_NM or low_s is None):
        wrong.append(f"the lock was opened at {opened_nm} N·m")
    if row.lock == "stays closed" and opened is not None:
        wrong.append(f"the lock was opened at {opened_nm} N·m")
    return Measured(
        id=row.id, begin_state=began, state=ended, low_s=low_s, down_s=down_s, begin_nm=abs(torque_nm[0]),
        peak_nm=max(map(abs, torque_nm)), rest_nm=abs(torque_nm[-1]), opened_nm=opened_nm,
        closed=bool(run.orders[-1].brake_on), by=by, wrong=tuple(wrong),
    )  # fmt: skip
