"""Help of the command line in groups, in the order in which people meet the commands."""

from __future__ import annotations

from typing import Any

from typer.core import TyperGroup

GROUPS: dict[str, tuple[str, ...]] = {
    "Measure": ("check", "run", "resume", "recover"),
    "Look at runs": ("list", "show", "report", "analyze", "metrics", "export", "replay"),
    "Models": ("model", "play-model"),
    "Line and gage": ("repeatability", "capability", "units", "gage", "master-part", "decision", "study"),
    "Bench": ("virtual-bench", "timing", "blank", "calibration", "faults"),
}
"""Headings of the help and the commands below each; a name may stand here before its command is there."""

OTHER = "Other"
"""Heading of commands that nobody has put into a group."""

LONGEST_HELP = 200
"""Characters of a command's first sentence; it is wrapped, not cut off."""


class GroupedHelp(TyperGroup):
    """A group of commands whose help lists them below the headings of `GROUPS`."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, each with its whole first sentence."""
        visible = {name: found for name in self.list_commands(ctx) if not (found := self.commands[name]).hidden}
        width = max((len(name) for name in visible), default=0)
        for heading, names in grouped(list(visible)).items():
            rows = [(name.ljust(width), visible[name].get_short_help_str(LONGEST_HELP)) for name in names]
            with formatter.section(heading):
                formatter.write_dl(rows)


def grouped(commands: list[str]) -> dict[str, list[str]]:
    """Return the commands below their headings; what has none is `OTHER`."""
    known = {name for names in GROUPS.values() for name in names}
    found = {heading: [name for name in names if name in commands] for heading, names in GROUPS.items()}
    found[OTHER] = [name for name in commands if name not in known]
    return {heading: names for heading, names in found.items() if names}
