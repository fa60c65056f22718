"""The command line. Every command imports what it needs when it runs, so that help answers at once."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

import os
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Annotated

import typer

from station import cli_blocks, cli_quality
from station.cli_faults import faults_app
from station.cli_help import GroupedHelp
from station.cli_options import DEFAULT_DATA, DataOption, JsonOption
from station.cli_studies import study_app
from station.errors import BenchFaultError, StationError

EXIT_BAD_INPUT = 2
EXIT_BENCH = 4
EXIT_PROGRAM_ERROR = 70
"""The program itself failed (EX_SOFTWARE of sysexits.h): none of the codes that say something about a unit."""

EXIT_NOBODY_READS = 141
"""As of a process that SIGPIPE ended: the reader of standard output went away, and no code may be taken for a PASS."""


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

app.add_typer(faults_app, name="faults")
app.add_typer(study_app, name="study")
cli_quality.register(app)

RecipeArgument = Annotated[str, typer.Argument(metavar="RECIPE", help="Recipe file, or the name of a shipped recipe.")]
BenchOption = Annotated[
    str | None,
    typer.Option("--bench", metavar="FILE", help="Bench file or shipped bench. Default: the embedded virtual bench."),
]
UnitOption = Annotated[
    str | None,
    typer.Option("--unit", metavar="NAME[:SEED]", help="Unit on the virtual bench: P1, worn, soft, tight, cracked ..."),
]
ScenarioOption = Annotated[
    Path | None,
    typer.Option("--scenario", metavar="FILE", help="Faults to inject into the virtual bench."),
]

PresetOption = Annotated[
    str | None,
    typer.Option(
        "--preset",
        metavar="NAME",
        help="Definitions of static, inverse, measurement, output, nabtesco, spinea or harmonic.",
    ),
]


def _print_version(asked: bool) -> None:  # noqa: FBT001 - typer calls it with the option's value
    if asked:
        import importlib.metadata

        try:
            version = importlib.metadata.version("lostmotion")
        except importlib.metadata.PackageNotFoundError:
            version = "from its source folder"
        typer.echo(f"lostmotion {version}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """End-of-line test bench for precision gear reducers: torsional stiffness, backlash and lost motion."""


@app.command()
def run(
    recipe: RecipeArgument,
    serial: Annotated[
        str | None,
        typer.Option("--serial", metavar="SN", help="Serial number of the unit. Required on a real bench."),
    ] = None,
    bench: BenchOption = None,
    data: DataOption = DEFAULT_DATA,
    unit: UnitOption = None,
    scenario: ScenarioOption = None,
    virtual_time: Annotated[
        bool,
        typer.Option("--virtual-time", help="Against the plant in process, faster than real time."),
    ] = False,
    operator: Annotated[
        str | None, typer.Option("--operator", metavar="NAME", help="Who measures, for 'lostmotion gage'.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Run a recipe: measure a unit, judge it, store the record.

    Ctrl-C once brings the torque to zero and stops; twice is a quick stop.
    Exit code: 0 PASS, 1 FAIL, 2 bad input, 3 NOT DECIDABLE, 4 bench fault or stopped,
    70 the program failed.
    """
    from station import command_run

    options = command_run.Options(recipe, serial, bench, data, unit, scenario, virtual_time, as_json, operator)
    raise typer.Exit(command_run.run(options))


@app.command()
def check(recipe: RecipeArgument, bench: BenchOption = None, as_json: JsonOption = False) -> None:
    """Check a recipe and show its load profile, duration and peak torque. Exit code: 0 in order, 2 not."""
    from station import command_check

    raise typer.Exit(command_check.check(recipe, bench, as_json=as_json))


@app.command()
def analyze(
    trace: Annotated[str, typer.Argument(metavar="TRACE", help="Stored run, or a CSV or Parquet file.")],
    recipe: Annotated[
        str | None,
        typer.Option("--recipe", metavar="RECIPE", help="How to evaluate. Default for a stored run: its own recipe."),
    ] = None,
    bench: Annotated[
        str | None,
        typer.Option("--bench", metavar="FILE", help="Bench the trace comes from: its fixture and calibrations."),
    ] = None,
    preset: PresetOption = None,
    monte_carlo: Annotated[
        int,
        typer.Option("--monte-carlo", metavar="N", min=0, max=100_000, help="Draws beside the budget, into the JSON."),
    ] = 0,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Compute metrics and verdict of a trace. Exit code as run."""
    from station import command_analyze

    raise typer.Exit(
        command_analyze.analyze(trace, recipe, bench, data, preset=preset, as_json=as_json, draws=monte_carlo)
    )


@app.command()
def repeatability(
    runs: Annotated[list[str], typer.Argument(metavar="RUN...", help="Runs or traces of one unit, or its serial.")],
    recipe: Annotated[
        str | None,
        typer.Option("--recipe", metavar="RECIPE", help="Evaluate all by this recipe. Default: each run's own."),
    ] = None,
    preset: PresetOption = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Show mean and standard deviation of each metric over cycles and over runs of a unit. Exit code: 0, or 2."""
    from station import command_repeatability

    raise typer.Exit(command_repeatability.repeat(runs, recipe, preset, data, as_json=as_json))


@app.command()
def metrics(preset: PresetOption = None, as_json: JsonOption = False) -> None:
    """List the definitions of all metrics and the presets, or of one preset. Exit code: 0, or 2 for no such preset."""
    from station import command_metrics

    raise typer.Exit(command_metrics.metrics(preset, as_json=as_json))


app.command()(cli_blocks.blank)
app.command()(cli_blocks.calibration)


@app.command()
def show(
    name: Annotated[str, typer.Argument(metavar="RUN", help="Run id or part of it, serial number, folder, or 'last'.")],
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Show a stored run."""
    from station import command_show

    raise typer.Exit(command_show.show(name, data, as_json=as_json))


@app.command(name="list")
def list_runs(data: DataOption = DEFAULT_DATA, as_json: JsonOption = False) -> None:
    """List all stored runs, newest last."""
    from station import command_show

    raise typer.Exit(command_show.list_runs(data, as_json=as_json))


@app.command()
def virtual_bench(
    bench: BenchOption = None,
    can: Annotated[
        str | None,
        typer.Option("--can", metavar="WHERE", help="HOST:PORT, socketcan:CHANNEL, or slcan: be an adapter."),
    ] = None,
    modbus: Annotated[
        str | None,
        typer.Option("--modbus", metavar="WHERE", help="HOST:PORT, also the next two; rtu: serial ports."),
    ] = None,
    unit: UnitOption = None,
    scenario: ScenarioOption = None,
) -> None:
    """Run the virtual bench alone; prints its ports as one JSON line when it is ready."""
    from station import command_virtual_bench

    raise typer.Exit(command_virtual_bench.virtual_bench(bench, can, modbus, unit, scenario))


@app.command()
def export(
    name: Annotated[str, typer.Argument(metavar="RUN", help="Run id or part of it, serial number, folder, or 'last'.")],
    file_format: Annotated[
        str,
        typer.Option("--format", metavar="FORMAT", help="parquet, csv, mat or tdms."),
    ] = "parquet",
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="File or folder to write. Default: RUN.FORMAT in this folder."),
    ] = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Write every scan of a run as Parquet, CSV, MATLAB or TDMS, with units and metadata."""
    from station import command_export

    raise typer.Exit(command_export.export(name, data, file_format, out, as_json=as_json))


@app.command()
def resume(
    name: Annotated[str, typer.Argument(metavar="RUN", help="Run id or part of it, serial number, folder, or 'last'.")],
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Take over a run whose desk died, to its end and its verdict. Exit code as run.

    Ctrl-C once brings the torque to zero and stops; twice is a quick stop.
    """
    from station import command_resume

    raise typer.Exit(command_resume.resume_run(name, data, as_json=as_json))


@app.command()
def recover(
    bench: BenchOption = None,
    data: DataOption = DEFAULT_DATA,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask: what must be checked has been checked.")] = False,
    as_json: JsonOption = False,
) -> None:
    """The way back after a fault: show how the bench was left, acknowledge, bring the torque to zero, open the lock.

    Nothing is enabled before you say so. The bench is the one of the newest run, or the one that --bench names.
    Exit code: 0 the unit is unloaded and the lock open, 2 bad input, 4 not.
    """
    from station import command_recover

    raise typer.Exit(command_recover.recover(bench, data, yes=yes, as_json=as_json))


@app.command()
def replay(
    name: Annotated[str, typer.Argument(metavar="RUN", help="Run id or part of it, serial number, folder, or 'last'.")],
    recipe: Annotated[
        str | None,
        typer.Option("--recipe", metavar="OTHER", help="What if: interlocks and limits of another recipe."),
    ] = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Step the controller through a record and compare every order, byte for byte.

    Exit code: 0 identical, 1 not (the first differing scan is printed), 2 bad input or a damaged record, 3 identical,
    but the record was altered after the run.
    """
    from station import command_replay

    raise typer.Exit(command_replay.replay_run(name, data, recipe, as_json=as_json))


@app.command()
def timing(
    seconds: Annotated[float, typer.Option("--seconds", metavar="N", min=0.1, help="How long to measure.")] = 10.0,
    bench: BenchOption = None,
    recipe: Annotated[
        str | None,
        typer.Option(
            "--recipe", metavar="RECIPE", help="Recipe whose period and bench are meant. Default: a shipped one."
        ),
    ] = None,
    period_us: Annotated[
        int | None,
        typer.Option("--period-us", metavar="N", min=100, max=100_000, help="Measure at another scan period [µs]."),
    ] = None,
    spin_us: Annotated[
        int | None,
        typer.Option("--spin-us", metavar="N", min=0, max=1000, help="Spin this long before each deadline [µs]."),
    ] = None,
    highest_rate: Annotated[
        bool, typer.Option("--highest-rate", help="Measure one scan rate after the other, N seconds each.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Measure what this machine can do: the whole scan without a unit under test. Nothing moves.

    Exit code: 0, or 1 when more than 0.1 % of the periods were missed (at 1 kHz with --highest-rate) or a record was
    lost; 2 bad input.
    """
    from station import command_timing
    from station.timing_run import Asked

    asked = Asked(
        seconds,
        None if period_us is None else period_us * 1000,
        None if spin_us is None else spin_us * 1000,
    )
    command = command_timing.rates if highest_rate else command_timing.timing
    raise typer.Exit(command(recipe, bench, asked, as_json=as_json))


def _bad_input() -> tuple[type[Exception], ...]:
    """Return the errors that a person can mend. Called when one was raised: its module is loaded then anyway."""
    loaded = sys.modules
    names = (
        ("recipes", "RecipeError"),
        ("analysis", "AnalysisError"),
        ("drivers.virtual.errors", "VirtualBenchError"),
    )
    return (StationError, *(getattr(loaded[module], name) for module, name in names if module in loaded))


def _refuse(error: Exception) -> None:
    """Tell what is wrong with the input, in words and, to a program that asked for it, as JSON; exit."""
    from station.json_errors import asked_for, errors_json

    show = getattr(error, "show", None)
    if show is not None:
        show()
    else:
        sys.stderr.write(f"{error}\n")
    code = getattr(error, "exit_code", EXIT_BAD_INPUT)
    if code == EXIT_BAD_INPUT and asked_for(sys.argv[1:]):
        sys.stdout.write(errors_json(error))
    sys.exit(code)


def _program_error(error: Exception) -> str:
    """Return one plain line on an error that nobody expected; its traceback goes to a file."""
    what = f"the program failed: {type(error).__name__}: {' '.join(str(error).split())}".rstrip(": ")
    try:
        handle, name = tempfile.mkstemp(prefix="lostmotion-error-", suffix=".txt")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(f"{' '.join(sys.argv)}\n\n{''.join(traceback.format_exception(error))}")
    except OSError as refused:
        where = f"its traceback could not be stored ({refused.strerror})"
    else:
        where = f"please report it with {name}"
    return f"{what}; nothing is said about the unit. {where}"


def _nobody_reads() -> None:
    """Leave quietly: what is still buffered goes nowhere, instead of raising once more when the interpreter ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.__stdout__.fileno() if sys.__stdout__ else 1)
    sys.exit(EXIT_NOBODY_READS)


def main() -> None:
    """Run the command line; errors that a person can mend are plain text on standard error, without a traceback."""
    from station.plain_text import never_crash

    never_crash()
    try:
        ended = app(standalone_mode=False)
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
            _nobody_reads()
        raise
    except BrokenPipeError:
        _nobody_reads()
    except Exception as error:  # noqa: BLE001 - whatever it is, its exit code must not be one of a verdict
        # The command line's own refusals show themselves; their class is not part of typer's interface.
        if hasattr(error, "format_message") or isinstance(error, _bad_input()):
            _refuse(error)
        sys.stderr.write(f"{_program_error(error)}\n")
        sys.exit(EXIT_PROGRAM_ERROR)


if __name__ == "__main__":
    main()
