"""Commands on the bench itself: virtual, measured, and described for the bench file."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from typing import Annotated

import typer

from station.cli.options import (
    DEFAULT_DATA,
    BenchOption,
    DataOption,
    JsonOption,
    ScenarioOption,
    SeedOption,
    TraceArgument,
    UnitOption,
)

DueOption = Annotated[
    str | None,
    typer.Option(
        "--due", metavar="DATE", help="Date on which to measure this again. Default: one year after the measurement."
    ),
]


def virtual_bench(
    bench: BenchOption = None,
    can: Annotated[
        str | None,
        typer.Option(
            "--can", metavar="WHERE", help="CAN interface: HOST:PORT, socketcan:CHANNEL, or slcan for a serial adapter."
        ),
    ] = None,
    modbus: Annotated[
        str | None,
        typer.Option(
            "--modbus",
            metavar="WHERE",
            help="Modbus devices: HOST:PORT, also uses the next two ports; or rtu for serial ports.",
        ),
    ] = None,
    unit: UnitOption = None,
    scenario: ScenarioOption = None,
    pace: Annotated[
        str | None,
        typer.Option(
            "--pace",
            metavar="HOST:PORT",
            help="HOST:PORT at which a controller connects and sets the speed of the simulation. Default: a free port.",
        ),
    ] = None,
    seed: SeedOption = None,
    hands: Annotated[
        bool,
        typer.Option(
            "--hands",
            help="Read operator actions from standard input, such as 'io.estop trip' (presses the emergency stop).",
        ),
    ] = False,
) -> None:
    """Run the virtual bench alone; prints its ports as one JSON line when it is ready."""
    from station.cli.bench import virtual_bench as command_virtual_bench

    raise typer.Exit(
        command_virtual_bench.virtual_bench(bench, can, modbus, unit, scenario, pace=pace, seed=seed, hands=hands)
    )


def timing(
    seconds: Annotated[
        float, typer.Option("--seconds", metavar="N", min=0.1, help="Duration of the measurement [s].")
    ] = 10.0,
    bench: BenchOption = None,
    recipe: Annotated[
        str | None,
        typer.Option(
            "--recipe", metavar="RECIPE", help="Recipe that gives scan period and bench. Default: a shipped one."
        ),
    ] = None,
    period_us: Annotated[
        int | None,
        typer.Option("--period-us", metavar="N", min=100, max=100_000, help="Measure at another scan period [µs]."),
    ] = None,
    spin_us: Annotated[
        int | None,
        typer.Option(
            "--spin-us",
            metavar="N",
            min=0,
            max=1000,
            help="Keep the processor busy instead of sleeping for the last N µs before each scan.",
        ),
    ] = None,
    highest_rate: Annotated[
        bool, typer.Option("--highest-rate", help="Measure several scan rates, each for the time of --seconds.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Measure what this machine can do: the whole scan without a unit under test. Nothing moves.

    Exit code: 0, or 1 when more than 0.1 % of the periods were missed (at 1 kHz with --highest-rate) or a record was
    lost; 2 bad input.
    """
    from station.cli.bench import timing as command_timing
    from station.timing.report import Asked

    asked = Asked(
        seconds,
        None if period_us is None else period_us * 1000,
        None if spin_us is None else spin_us * 1000,
    )
    command = command_timing.rates if highest_rate else command_timing.timing
    raise typer.Exit(command(recipe, bench, asked, as_json=as_json))


def doctor(as_json: JsonOption = False) -> None:
    """Check what can make the scan late on this computer, and how to fix it.

    Exit code: 0 when nothing does, 1 when something does.
    """
    from station.cli.bench import timing as command_timing

    raise typer.Exit(command_timing.doctor(as_json=as_json))


def blank(
    trace: TraceArgument,
    recipe: Annotated[
        str | None,
        typer.Option(
            "--recipe",
            metavar="RECIPE",
            help="Recipe of the blank test (loop on a rigid dummy). Default for a stored run: its own recipe.",
        ),
    ] = None,
    bench: Annotated[
        str | None,
        typer.Option(
            "--bench", metavar="FILE", help="Bench file of the bench on which the file was recorded; of no other one."
        ),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option(
            "--id", metavar="ID", help="Name of the blank test (a loop on a rigid dummy), for the bench file."
        ),
    ] = None,
    due: DueOption = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Print a bench file's block 'fixture' from a loop on a rigid dummy: the fixture's deflection over torque."""
    from station.cli.bench import blank as command_blank

    raise typer.Exit(command_blank.blank(trace, recipe, bench, data, name=name, due=due, as_json=as_json))


def torque_ratio(
    points: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="CSV, Parquet or TDMS file with the columns torque_in_nm and torque_out_nm, or a stored run.",
        ),
    ],
    target: Annotated[
        list[str] | None,
        typer.Option(
            "--target", metavar="TORQUE", help="Output torque for which to print the input torque; may be repeated."
        ),
    ] = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Fit T_out = C + m·T_in to points of both torques: uncertainties, outliers, and the input torque of a target.

    A table gives one line; a stored run, or a file with named segments, one line per quadrant.
    """
    from station.cli.bench import torque_ratio as command_torque_ratio

    raise typer.Exit(command_torque_ratio.torque_ratio(points, target or [], data, as_json=as_json))


def calibration(
    runs: Annotated[
        list[str], typer.Argument(metavar="RUN...", help="Run of one unit; or one run of each of several units.")
    ],
    due: DueOption = None,
    data: DataOption = DEFAULT_DATA,
    as_json: JsonOption = False,
) -> None:
    """Print the torque ratio that runs measured as an entry of 'calibrations' in a bench file.

    Of several units: their mean, and how they differ, which is how wrong it may be for another unit.
    """
    from station.cli.bench import calibration as command_calibration

    raise typer.Exit(command_calibration.calibration(runs, data, due=due, as_json=as_json))
