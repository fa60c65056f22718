"""Runs whose records a rule of retention has removed, as their lines in the chain say: these are not missing."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from sqlalchemy import Connection, delete, insert, select

from station.records.chain.chain_file import Chain
from station.records.chain.entries import Entry
from station.records.chain.walk import Trust, trust_of
from station.store.tables import REMOVALS


def put_removals(connection: Connection, chain: Chain, lines: Mapping[str, Entry]) -> None:
    """Put what signed lines say of runs, by run, in the place of what earlier ones said of these.

    One of a key that nobody trusts takes no place of one that counts.
    """
    if lines:
        trust = trust_of(chain)
        said = removals(connection, chain, trust, list(lines))
        lines = {run: line for run, line in lines.items() if line.key in trust.keys or run not in said}
    if lines:
        connection.execute(delete(REMOVALS).where(REMOVALS.c.chain == chain.id, REMOVALS.c.run.in_(list(lines))))
        rows = [
            {"chain": chain.id, "run": run, "rule": str(line.fields["rule"]), "key": line.key}
            for run, line in lines.items()
        ]
        connection.execute(insert(REMOVALS), rows)


def removals(connection: Connection, chain: Chain, trust: Trust, runs: Collection[str] | None = None) -> dict[str, str]:
    """Return the rule by which each of these runs was removed, where somebody trusted says so; None: all runs."""
    asked = select(REMOVALS.c.run, REMOVALS.c.rule).where(REMOVALS.c.chain == chain.id, REMOVALS.c.key.in_(trust.keys))
    rows = connection.execute(asked if runs is None else asked.where(REMOVALS.c.run.in_(runs)))
    return dict(rows.tuples().all())


def removals_now(
    connection: Connection, chain: Chain, trust: Trust, runs: Collection[str], behind: int
) -> dict[str, str]:
    """Return the same of a store that may be behind its chain; of such a one the chain itself is read."""
    if not behind:
        return removals(connection, chain, trust, runs)
    lines = chain.removed()
    return {run: str(lines[run].fields["rule"]) for run in runs if run in lines and lines[run].key in trust.keys}
