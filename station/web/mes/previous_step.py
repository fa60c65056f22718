"""What the MES has said of a unit's previous process step, and whether the MES is away."""

from __future__ import annotations

from typing import NamedTuple

from sqlalchemy import Connection, delete, insert, select, update

from station.wall_clock import WALL_CLOCK, now_text
from station.web.mes.settings import UNVERIFIED, MesSettings
from station.web.people.database import MES_CONTACT, MES_UNITS

PASSED, FAILED = "passed", "failed"


class PreviousStep(NamedTuple):
    """The previous process step of a unit: `result` passed, failed or '' (the MES has not said); the MES is `away`.

    `silent_s`: for how long nothing was heard of the MES [s]; None: never heard. `may_be_unverified`: the plant
    measures units while the MES is away.
    """

    result: str
    away: bool
    silent_s: float | None
    may_be_unverified: bool

    @property
    def unverified(self) -> bool:
        """Whether the unit may be measured though nobody has said that the step before is passed."""
        return not self.result and self.away and self.may_be_unverified


def previous_step(connection: Connection, settings: MesSettings, serial: str) -> PreviousStep:
    """Return what is known of a unit now."""
    found = connection.execute(select(MES_UNITS.c.previous_step).where(MES_UNITS.c.serial == serial)).scalar()
    silent_s = _silent_s(connection)
    away = silent_s is None or silent_s > settings.away_after_s
    return PreviousStep(found or "", away, silent_s, settings.when_away == UNVERIFIED)


def announce(connection: Connection, serial: str, result: str, name: str) -> None:
    """Keep what the MES says of a unit; the newest word counts."""
    connection.execute(delete(MES_UNITS).where(MES_UNITS.c.serial == serial))
    connection.execute(insert(MES_UNITS).values(serial=serial, previous_step=result, name=name, at=now_text()))


def heard(connection: Connection) -> None:
    """Note that the MES was heard now."""
    now_s = WALL_CLOCK.now().timestamp()
    if not connection.execute(update(MES_CONTACT).values(heard_s=now_s)).rowcount:
        connection.execute(insert(MES_CONTACT).values(number=1, heard_s=now_s))


def _silent_s(connection: Connection) -> float | None:
    heard_s = connection.execute(select(MES_CONTACT.c.heard_s)).scalar()
    return None if heard_s is None else max(0.0, WALL_CLOCK.now().timestamp() - heard_s)
