"""The command line: which commands there are, and how a command ends.

Every command imports what it needs when it runs, so that help answers at once.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping
from copy import copy
from functools import cache, partial
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_group

from station.cli.bench import commands as cli_bench
from station.cli.bench.setup_commands import profile_app, schema
from station.cli.commissioning.commands import bench_app
from station.cli.errors import EXIT_BENCH, can_be_mended, nobody_reads, program_failed, refuse, refuse_time_zone
from station.cli.faults.commands import faults_app
from station.cli.line import commands as cli_line
from station.cli.measure import commands as cli_measure
from station.cli.opcua.commands import opcua_app
from station.cli.quality.commands import quality_app
from station.cli.runs import commands as cli_runs
from station.cli.store import commands as cli_store
from station.cli.store.archive_commands import archive_app
from station.cli.store.commands import retention_app, store_app
from station.cli.studies import model_commands as cli_models
from station.cli.studies.commands import study_app
from station.cli.web import commands as cli_web
from station.cli.web.accounts_commands import recipes_app, users_app
from station.cli.web.bypass_commands import bypass_app
from station.cli.web.labels_commands import labels_app
from station.errors import BenchFaultError
from station.own_program import keep_out_of_working_folder
from station.plain_text import never_crash

if TYPE_CHECKING:
    from station.run.ahead import Ahead

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


app = typer.Typer(
    name="lostmotion",
    help="End-of-line test bench for precision gear reducers: torsional stiffness, backlash and lost motion.",
    cls=GroupedHelp,
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)

COMMANDS: dict[str, dict[str, Callable[..., None] | typer.Typer]] = {
    "Measure": {
        "check": cli_measure.check,
        "run": cli_measure.run,
        "line": cli_measure.line,
        "resume": cli_measure.resume,
        "conclude": cli_measure.conclude,
        "recover": cli_measure.recover,
        "jog": cli_measure.jog,
    },
    "Look at runs": {
        "list": cli_runs.list_runs,
        "runs": cli_runs.runs,
        "show": cli_runs.show,
        "report": cli_runs.report,
        "analyze": cli_runs.analyze,
        "reevaluate": cli_runs.reevaluate,
        "metrics": cli_runs.metrics,
        "export": cli_runs.export,
        "replay": cli_runs.replay,
        "verify": cli_runs.verify,
        "backup": cli_store.backup,
        "restore": cli_store.restore,
        "retention": retention_app,
        "archive": archive_app,
        "store": store_app,
    },
    "Station": {
        "serve": cli_web.serve,
        "recipes": recipes_app,
        "users": users_app,
        "bypass": bypass_app,
        "audit": cli_web.audit_app,
        "labels": labels_app,
        "opcua": opcua_app,
    },
    "Models": {
        "model": cli_models.model,
        "play-model": cli_models.play_model,
    },
    "Line and gage": {
        "repeatability": cli_line.repeatability,
        "capability": cli_line.capability,
        "units": cli_line.units,
        "gage": cli_line.gage,
        "master-part": cli_line.master_part,
        "decision": cli_line.decision,
        "quality": quality_app,
        "study": study_app,
    },
    "Bench": {
        "virtual-bench": cli_bench.virtual_bench,
        "doctor": cli_bench.doctor,
        "timing": cli_bench.timing,
        "blank": cli_bench.blank,
        "torque-ratio": cli_bench.torque_ratio,
        "calibration": cli_bench.calibration,
        "key": cli_runs.key,
        "schema": schema,
        "bench": bench_app,
        "profile": profile_app,
        "faults": faults_app,
    },
}
"""Headings of the help and the commands below each, in the order in which people meet them."""


def _register() -> None:
    """Put every command of the table on the command line."""
    for heading, commands in COMMANDS.items():
        for name, command in commands.items():
            if isinstance(command, typer.Typer):
                app.add_typer(command, name=name, rich_help_panel=heading)
            else:
                app.command(name, rich_help_panel=heading)(command)


_register()


def _print_version(asked: bool) -> None:  # noqa: FBT001 - typer calls it with the option's value
    if asked:
        from station.version import version  # noqa: PLC0415 - only for this option

        typer.echo(f"lostmotion {version()}")
        raise typer.Exit


STORE_URL = "LOSTMOTION_STORE"
"""Environment variable that names the database of the store."""


@app.callback()
def options(
    context: typer.Context,
    version: Annotated[  # noqa: FBT002, ARG001 - typer reads this signature, and calls `_print_version`
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version."),
    ] = False,
    store: Annotated[
        str | None,
        typer.Option(
            "--store", metavar="URL", help=f"Database: sqlite:///FILE or postgresql://USER@HOST/NAME; also {STORE_URL}."
        ),
    ] = None,
) -> None:
    """End-of-line test bench for precision gear reducers: torsional stiffness, backlash and lost motion."""
    if store is not None:
        before = os.environ.get(STORE_URL)
        os.environ[STORE_URL] = store
        context.call_on_close(partial(_put_back, before))


def _put_back(before: str | None) -> None:
    if before is None:
        os.environ.pop(STORE_URL, None)
    else:
        os.environ[STORE_URL] = before


def command_line(word: str = "") -> TyperGroup:
    """Return the commands with their options: all, or the one alone that a word names.

    They are made of the table and the signatures, all of them in 0.2 s: as long as anything else that answers at once.
    """
    return _made(word if any(word in commands for commands in COMMANDS.values()) else "")


@cache
def _made(word: str) -> TyperGroup:
    asked = copy(app)
    if word:
        asked.registered_commands = [one for one in app.registered_commands if one.name == word]
        asked.registered_groups = [one for one in app.registered_groups if one.name == word]
    return get_group(asked)


def main(ahead: Mapping[str, Ahead] | None = None) -> None:
    """Run the command line; errors that a person can mend are plain text on standard error, without a traceback.

    ahead: processes that were started before a run and wait for it, by their modules.
    """
    never_crash()
    keep_out_of_working_folder()
    try:
        refuse_time_zone()
        ended = command_line(*sys.argv[1:2])(standalone_mode=False, obj=ahead)
        sys.stdout.flush()  # a reader that is gone is told here, not when the interpreter ends with a code of its own
        sys.exit(ended)
    except BenchFaultError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(EXIT_BENCH)
    except (KeyboardInterrupt, typer.Abort):
        sys.stderr.write("interrupted before anything moved\n")
        sys.exit(EXIT_BENCH)
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # typer makes 1 of it, which is FAIL
            nobody_reads()
        raise
    except BrokenPipeError:
        nobody_reads()
    except Exception as error:  # noqa: BLE001 - whatever it is, its exit code must not be one of a verdict
        if can_be_mended(error):
            refuse(error)
        program_failed(error)


if __name__ == "__main__":
    main()
