"""The commands of `lostmotion bench`, in the order of the steps."""

# ruff: noqa: PLC0415, FBT002, PLR0917 - imports inside the commands keep --help fast; typer reads these signatures

from __future__ import annotations

from typing import Annotated

import typer

from station.cli.options import DEFAULT_DATA, DataOption, JsonOption

bench_app = typer.Typer(
    help="Commission a new bench, step by step; a record of it is kept beside the bench file.",
    no_args_is_help=True,
)

BenchFileOption = Annotated[str, typer.Option("--bench", metavar="FILE", help="Bench file of the bench to commission.")]
ByOption = Annotated[
    str | None,
    typer.Option(
        "--by", metavar="NAME", help="Name of the person who does the step. Default: the user of this computer."
    ),
]
PatienceOption = Annotated[
    float, typer.Option("--seconds", metavar="N", min=1, max=600, help="Longest time to wait for each action [s].")
]
TrialRecipeOption = Annotated[
    str,
    typer.Option("--recipe", metavar="RECIPE", help="Recipe of the unit on the bench. Its ratings and limits apply."),
]


@bench_app.command()
def status(bench: BenchFileOption, as_json: JsonOption = False) -> None:
    """Print the state of each step, and what has changed since it was done.

    Exit code: 0; 1 while a step is not passed; 2 bad input.
    """
    from station.cli.commissioning import steps

    raise typer.Exit(steps.status(bench, as_json=as_json))


@bench_app.command()
def probe(
    bench: BenchFileOption,
    seconds: Annotated[
        float, typer.Option("--seconds", metavar="N", min=0.1, max=60, help="How long the live values are read [s].")
    ] = 2.0,
    by: ByOption = None,
    as_json: JsonOption = False,
) -> None:
    """Step 1: check the identity of each device and the settings of the drive, and show live values.

    Nothing is written or enabled.

    Exit code: 0 passed; 1 not passed; 2 bad input; 4 bench fault.
    """
    from station.cli.commissioning import steps

    raise typer.Exit(steps.probe(bench, seconds, by, as_json=as_json))


@bench_app.command()
def registers(
    bench: BenchFileOption,
    seconds: PatienceOption = 60.0,
    part: Annotated[
        str | None, typer.Option("--device", metavar="NAME", help="Check only this device: brake, remote_io, ...")
    ] = None,
    without: Annotated[
        list[str] | None,
        typer.Option("--without", metavar="CHANNEL", help="Torque sensor that cannot be loaded by hand; repeatable."),
    ] = None,
    by: ByOption = None,
    as_json: JsonOption = False,
) -> None:
    """Step 2: show the raw registers of the sensors in both word orders, while you load the torque sensors by hand.

    Exit code: 0 passed; 1 not passed; 2 bad input; 4 bench fault.
    """
    from station.cli.commissioning import steps

    raise typer.Exit(steps.registers(bench, part, seconds, tuple(without or ()), by, as_json=as_json))


@bench_app.command()
def io(
    bench: BenchFileOption, seconds: PatienceOption = 60.0, by: ByOption = None, as_json: JsonOption = False
) -> None:
    """Step 3: press the emergency stop and open the guard when asked. The command shows which inputs changed.

    Exit code: 0 passed; 1 not passed; 2 bad input; 4 bench fault.
    """
    from station.cli.commissioning import steps

    raise typer.Exit(steps.contacts(bench, seconds, by, as_json=as_json))


def _small_run(name: str, *, help: str) -> None:  # noqa: A002 - as typer calls it
    """Add a step that makes small runs on a locked unit: all of them have the same options."""

    @bench_app.command(name, help=f"{help}\n\nExit code: 0 passed; 1 not passed; 2 bad input; 4 bench fault.")
    def step(
        bench: BenchFileOption,
        recipe: TrialRecipeOption,
        data: DataOption = DEFAULT_DATA,
        by: ByOption = None,
        as_json: JsonOption = False,
    ) -> None:
        from station.cli.commissioning import trials

        raise typer.Exit(trials.STEPS[name](bench, recipe, data, by, as_json=as_json))


_small_run(
    "direction",
    help="Step 4: find the signs of motor, torques and angles with small torques on a locked unit. The shaft moves.",
)
_small_run(
    "latency",
    help="Step 5: measure with small torque steps on the locked unit how late each channel's values arrive.",
)


@bench_app.command()
def watchdogs(bench: BenchFileOption, by: ByOption = None, as_json: JsonOption = False) -> None:
    """Step 6: stop sending SYNC, heartbeat, then all messages, and check that the drive reacts to each.

    The drive is enabled, with zero torque.

    Exit code: 0 passed; 1 not passed; 2 bad input; 4 bench fault.
    """
    from station.cli.commissioning import steps

    raise typer.Exit(steps.watchdogs(bench, by, as_json=as_json))


_small_run(
    "tune",
    help="Step 7: measure the torque controller with small torque steps and propose its gain. Nothing is written.",
)


@bench_app.command()
def timing(
    bench: BenchFileOption,
    recipe: TrialRecipeOption,
    seconds: Annotated[
        float, typer.Option("--seconds", metavar="N", min=0.1, help="Duration of the measurement [s].")
    ] = 60.0,
    by: ByOption = None,
    as_json: JsonOption = False,
) -> None:
    """Step 8: check that this computer keeps the scan period with these devices, as `lostmotion timing` does.

    Exit code: 0 passed; 1 not passed; 2 bad input; 4 bench fault.
    """
    from station.cli.commissioning import trials

    raise typer.Exit(trials.timing(bench, recipe, seconds, by, as_json=as_json))
