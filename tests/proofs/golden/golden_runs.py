"""The golden runs: what happens in each, and how it must end. Made anew by `make golden`.

Between them they go through every state and every family of faults that the virtual bench can play: contacts, drive,
CAN, Modbus devices, sensors, lock, operator, and the machine itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from controller.controller import Controller
from definitions.image import REMOTE_IO_FIELDS, Command, Image, Orders
from definitions.program import Program
from recipes.compiler.jog import PERIOD_NS, compile_jog, jog_bench, jog_speed_rad_s
from station.bench.request import Job, load_job
from station.records.samples.scan_record import pack

FOLDER = Path(__file__).parent
IN_RAMP = {"time_s": 9.0}
START_AT = 50
LONGEST_SCANS = 8000

RESOLUTION = {
    "torque_in_nm": 2.0**-11,
    "torque_out_nm": 2.0**-3,
    "angle_in_rad": 2.0**-18,
    "angle_out_rad": 2.0**-21,
    "brake_current_a": 2.0**-10,
    **{field.name: 2.0**-4 for field in REMOTE_IO_FIELDS if field.unit == "°C"},
}
"""Steps to which the sensors are rounded before the controller sees them: noise is most of a file otherwise."""


@dataclass(frozen=True)
class Golden:
    """One golden run: faults on the bench, commands and missed periods by scan number, state and cause at its end.

    jog: it is a jog of this bench, and no run.
    """

    name: str
    end: str
    cause: str = ""
    faults: tuple[dict[str, object], ...] = ()
    commands: dict[int, Command] = field(default_factory=dict)
    missed: dict[int, int] = field(default_factory=dict)
    jog: bool = False

    @property
    def path(self) -> Path:
        return FOLDER / f"{self.name}.golden.xz"


def _fault(target: str, verb: str, value: float | None = None) -> tuple[dict[str, object], ...]:
    return ({"target": target, "verb": verb, "value": value, "when": IN_RAMP},)


def _pressed(at_s: float, for_ms: float) -> dict[str, object]:
    return {"target": "io.enabling_device", "verb": "press", "when": {"time_s": at_s}, "for_ms": for_ms}


def _held(key: Command, first: int, last: int) -> dict[int, Command]:
    return dict.fromkeys(range(first, last, 50), key)


GOLDEN_RUNS: tuple[Golden, ...] = (
    Golden("normal", "complete"),
    Golden("operator-stop", "stopped", commands={2300: Command.STOP}),
    Golden("operator-quick-stop", "fault", "operator_quick_stop", commands={2300: Command.QUICK_STOP}),
    # the drive loses its torque before the remote I/O has been asked
    Golden("emergency-stop", "fault", "drive_dropped_out", _fault("io.estop", "trip")),
    Golden("guard-open", "fault", "guard_open", _fault("io.guard", "open")),
    Golden("heartbeat-lost", "fault", "drive_heartbeat_lost", _fault("can.drive.heartbeat", "off")),
    Golden("process-data-lost", "fault", "drive_data_stale", _fault("can.drive.tpdo1", "off")),
    Golden("drive-emergency", "fault", "drive_fault", _fault("drive.emcy", "raise", 0x7121)),
    Golden("amplifier-lost", "fault", "amplifier_lost", _fault("modbus.amplifier", "off")),
    Golden("brake-link-lost", "fault", "brake_link_lost", _fault("modbus.brake", "off")),
    Golden("remote-io-lost", "fault", "remote_io_lost", _fault("modbus.remote_io", "off")),
    Golden("torque-sensor-offset", "fault", "torque_out_trip", _fault("sensor.torque_out", "offset", 200.0)),
    Golden("torque-sensor-stuck", "fault", "torque_channels_disagree", _fault("sensor.torque_out", "stuck")),
    Golden("lock-slip", "fault", "lock_slip", _fault("lock", "slip", 0.2)),
    Golden("periods-missed", "fault", "missed_periods", missed={1800: 3, 2300: 8}),
    Golden(
        "reset-after-fault",
        "stopped",
        commands={2300: Command.QUICK_STOP, 2900: Command.ACKNOWLEDGE, 2950: Command.RESET},
    ),
    # one movement that the enabling device ends, one that the key ends, each way
    Golden(
        "jog",
        "stopped",
        faults=(_pressed(0.5, 800), _pressed(1.7, 1500)),
        commands=_held(Command.JOG_POSITIVE, 200, 1200)
        | _held(Command.JOG_NEGATIVE, 1400, 2300)
        | {3000: Command.STOP},
        jog=True,
    ),
)


def job() -> Job:
    """Return the recipe of the golden runs on the shipped virtual bench."""
    return load_job(str(FOLDER / "golden.yaml"), None)


def program_of(golden: Golden, work: Job) -> Program:
    """Return the program of a golden run."""
    return compile_jog(work.bench, jog_speed_rad_s(work.bench)) if golden.jog else work.program


class _Rounding:
    """The virtual bench with its sensors rounded."""

    def __init__(self, bench: object) -> None:
        self._bench = bench

    def read(self, scan: int, missed: int, command: int) -> Image:
        image = self._bench.read(scan, missed, command)
        return image._replace(**{name: round(getattr(image, name) / q) * q for name, q in RESOLUTION.items()})

    def write(self, orders: Orders, scan: int) -> None:
        self._bench.write(orders, scan)


@contextmanager
def _bench(golden: Golden, work: Job) -> Iterator[_Rounding]:
    from station.bench.assemble_virtual import virtual_config  # noqa: PLC0415
    from station.bench.virtual_unit import VirtualUnit  # noqa: PLC0415
    from virtual_bench.faults.scenario import Scenario  # noqa: PLC0415
    from virtual_bench.in_process import VirtualTimeBench  # noqa: PLC0415 - compiles the physics; replay needs none

    scenario = Scenario.model_validate({"scenario": {"name": golden.name}, "faults": golden.faults})
    config = virtual_config(
        jog_bench(work.bench) if golden.jog else work.bench, work.profile_paths, VirtualUnit("P1:1", seed=1)
    )
    bench = VirtualTimeBench(config, PERIOD_NS if golden.jog else work.recipe.sampling.period_ns, scenario)
    yield _Rounding(bench)
    assert bench.faults.unseen() == [], f"{golden.name}: a fault had no effect"


def make(golden: Golden, work: Job) -> bytes:
    """Run a golden run in virtual time and return its records."""
    controller = Controller(program_of(golden, work))
    records: list[bytes] = []
    with _bench(golden, work) as bench:
        scan = -1
        while not controller.finished or scan <= max(golden.commands, default=0):
            missed = golden.missed.get(len(records), 0)
            scan += 1 + missed
            command = Command.START if scan == START_AT else golden.commands.get(scan, Command.NONE)
            image = bench.read(scan, missed, int(command))
            orders = controller.step(image, scan)
            bench.write(orders, scan)
            records.append(pack((len(records), scan, 0, 0), image, orders))
            assert scan < LONGEST_SCANS, f"{golden.name}: does not end"
    return b"".join(records)
