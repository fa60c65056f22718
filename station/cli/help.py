"""Help of the command line in groups, in the order in which people meet the commands."""

from __future__ import annotations

from typing import Any

from typer.core import TyperGroup

LONGEST_HELP = 200
"""Characters of a command's first sentence; it is wrapped, not cut off."""


class GroupedHelp(TyperGroup):
    """A group of commands whose help lists them below the headings that they were registered with."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the commands, each with its whole first sentence; what has commands of its own ends its section."""
        width = max(map(len, self.commands))
        sections: dict[str, list[tuple[str, str]]] = {}
        for name in sorted(self.list_commands(ctx), key=lambda name: isinstance(self.commands[name], TyperGroup)):
            command = self.commands[name]
            row = (name.ljust(width), command.get_short_help_str(LONGEST_HELP))
            sections.setdefault(command.rich_help_panel, []).append(row)  # type: ignore[attr-defined]
        for heading, rows in sections.items():
            with formatter.section(heading):
                formatter.write_dl(rows)
