"""Step `watchdogs`: what the drive does when its controller falls silent, measured with the drive enabled at no torque.

Three trials, each after a set-up of its own: SYNC and set-points stop while the heartbeat goes on; the heartbeat stops
while the others go on; everything stops, as after SIGKILL. Some stacks look at a synchronous PDO only when a SYNC comes
(0x1400:5 then guards nothing), and some hold 0x1016 and do not act on it: reading back shows neither.

Without SYNC the drive sends no process data, so its status word is asked for by SDO, one request after the other. The
time of a reaction is that of the first answer, or process data, that says so; the one before is its lower bound.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from controller.aftermath import DRIVE_IS_OFF
from controller.preparation import ENABLE_PATH
from definitions.image import DriveCommand, DriveMode, DriveState, Orders
from definitions.protections import NONE
from drivers.can.bus import CanLink
from drivers.can.wires import Frame
from drivers.config import DriveConfig
from drivers.errors import DriverError, Problem
from drivers.servo_drive.cia402 import decode_state
from drivers.servo_drive.drive import CanDrive, frames_per_poll
from drivers.servo_drive.emcy import explain_emcy
from drivers.servo_drive.pdo import (
    EMCY_BASE,
    HEARTBEAT_BASE,
    SDO_ANSWER_BASE,
    SDO_REQUEST_BASE,
    SYNC_COB_ID,
    rpdo_cob_id,
)
from drivers.servo_drive.sdo import NMT_ENTER_PRE_OPERATIONAL, NMT_RESET_COMMUNICATION
from drivers.servo_drive.setup import set_up_drive
from drivers.wire_bench import in_scans
from station.documents.commissioning import Figure, Finding
from station.scan.schedule import RealTimeSchedule

SYNC, SETPOINTS, HEARTBEAT = "SYNC", "set-points", "heartbeat"


class Trial(NamedTuple):
    """One trial: what is withheld, and which protection of the drive answers for it (None: any of them)."""

    id: str
    title: str
    withheld: frozenset[str]
    protection: str | None


TRIALS: tuple[Trial, ...] = (
    Trial("setpoints", "SYNC and set-points stop", frozenset({SYNC, SETPOINTS}), "setpoint_timeout"),
    Trial("heartbeat", "the heartbeat stops", frozenset({HEARTBEAT}), "controller_heartbeat"),
    Trial("everything", "everything stops, as after SIGKILL", frozenset({SYNC, SETPOINTS, HEARTBEAT}), None),
)

ENABLE_MOST_S = 5.0
ENABLED_S = 0.2
"""How long the drive is enabled, with everything in order, before something is withheld."""

LEAST_WAIT_S = 0.5
WAITS = 3.0
"""Multiples of the longest time-out of the bench file for which a reaction is waited for, and at least so long."""

LATE = 1.5
GRACE_S = 0.05
"""A reaction later than so many times its time-out, and this on top, is no longer the one that was set."""

OFF_MOST_S = 2.0
"""Longest time for the torque to be off once the drive has reacted."""

RESET_SCANS = 100
_NO_ORDERS = Orders(*[0] * len(Orders._fields))
_READ_STATUS_WORD = bytes((0x40, 0x41, 0x60, 0, 0, 0, 0, 0))
_STATUS_WORD_READ = bytes((0x4B, 0x41, 0x60, 0))


class Reaction(NamedTuple):
    """What the drive did in a trial.

    acted: whether it left OPERATION ENABLED; after_s: when at the latest, [s] from the last frame of what was withheld;
    seen_enabled_s: when it was seen enabled last; state: in which it was seen then; off_s: when it was without torque,
    None when it never was; emcy_code: of the first emergency message, 0 without one; timeout_s: what the bench file
    asks for (the longest where any may act), None where nothing supervises it.
    """

    trial: str
    acted: bool
    after_s: float
    seen_enabled_s: float
    state: DriveState
    off_s: float | None
    emcy_code: int
    timeout_s: float | None


class _Withholding:
    """A link that lets the frames of what is withheld not through; everything else is the link's."""

    def __init__(self, link: CanLink, config: DriveConfig) -> None:
        self._link = link
        self._ids = {
            SYNC_COB_ID: SYNC,
            HEARTBEAT_BASE + config.controller_node_id: HEARTBEAT,
            **{rpdo_cob_id(pdo, config.node_id): SETPOINTS for pdo in config.profile.receive_pdos},
        }
        self.withheld: frozenset[str] = frozenset()
        self.passed_s = dict.fromkeys((SYNC, SETPOINTS, HEARTBEAT), 0.0)
        self.status_words: list[tuple[float, int]] = []
        self.emergencies: list[tuple[float, int]] = []
        self._answer = SDO_ANSWER_BASE + config.node_id
        self._emcy = EMCY_BASE + config.node_id
        self._request: Frame = (SDO_REQUEST_BASE + config.node_id, _READ_STATUS_WORD)
        self._asked = False

    def __getattr__(self, name: str) -> object:
        return getattr(self._link, name)

    def send_frames(self, frames: Sequence[Frame]) -> bool:
        """Send what is not withheld, and note when each kind went out last."""
        now = time.monotonic()
        passing = [frame for frame in frames if self._ids.get(frame[0]) not in self.withheld]
        for cob_id, _ in passing:
            kind = self._ids.get(cob_id)
            if kind is not None:
                self.passed_s[kind] = now
        return self._link.send_frames(passing) if passing else True

    def take(self, most: int) -> list[Frame]:
        """Take frames, and note status words that were asked for and emergency messages."""
        frames = self._link.take(most)
        now = time.monotonic()
        for cob_id, data in frames:
            if cob_id == self._answer and data[:4] == _STATUS_WORD_READ:
                self._asked = False
                self.status_words.append((now, data[4] | data[5] << 8))
            elif cob_id == self._emcy and len(data) == 8 and (code := data[0] | data[1] << 8):
                self.emergencies.append((now, code))
        return frames

    def ask(self) -> None:
        """Ask for the status word by SDO, once the answer before has come."""
        if not self._asked:
            self._asked = self._link.send_frames((self._request,))


@dataclass
class _Scan:
    """A scan with the drive alone, which gets no torque ever."""

    drive: CanDrive
    schedule: RealTimeSchedule
    unsafe: Callable[[], str]
    scan: int = 0

    def step(self, command: DriveCommand) -> DriveState:
        """Wait for the next period, take what has come, send one order; return the drive's state as its PDOs say it.

        Raises:
            DriverError: somebody pressed the emergency stop or opened the guard, or the bus is gone.

        """
        self.schedule.wait()
        self.scan += 1 + self.schedule.missed
        self.drive.poll(self.scan, self.schedule.missed)
        why = self.unsafe() or (self.drive.link.lost and f"the bus is lost: {self.drive.link.lost_because}") or ""
        if why:
            problem = Problem("the trial was given up", "watchdogs", why, "a bench at rest", "then do this step again")
            raise DriverError(problem)
        mode = int(DriveMode.CYCLIC_SYNC_TORQUE)
        self.drive.send(_NO_ORDERS._replace(drive_command=command, drive_mode=mode), self.scan)
        return decode_state(self.drive.value("statusword"))


def measure(link: CanLink, config: DriveConfig, period_ns: int, trial: Trial, unsafe: Callable[[], str]) -> Reaction:
    """Set the drive up, enable it at no torque, withhold, and watch what it does; it is left without power.

    unsafe: looks at the contacts of the safety chain, and says what speaks against an enabled drive.

    Raises:
        DriverError: the drive cannot be set up or enabled, or the trial was given up.

    """
    set_up_drive(link, config, period_ns)
    gate = _Withholding(link, config)
    most_frames = frames_per_poll(period_ns, link.config.bitrate)
    heartbeat_scans = in_scans(config.controller_heartbeat_s, period_ns)
    drive = CanDrive(gate, config, heartbeat_scans, most_frames=most_frames)  # type: ignore[arg-type]
    scan = _Scan(drive, RealTimeSchedule(period_ns), unsafe)
    scan.schedule.start()
    try:
        _enable(scan, config)
        return _watch(scan, gate, config, trial)
    finally:
        gate.withheld = frozenset()
        _leave(link, drive, config)


def _enable(scan: _Scan, config: DriveConfig) -> None:
    until = time.monotonic() + ENABLE_MOST_S
    enabled_s: float | None = None
    resets = 0
    while enabled_s is None or time.monotonic() < enabled_s + ENABLED_S:
        state = decode_state(scan.drive.value("statusword"))
        if state is DriveState.FAULT:
            resets += 1
            with_bit = resets // RESET_SCANS % 2
            state = scan.step(DriveCommand.FAULT_RESET if with_bit else DriveCommand.DISABLE_VOLTAGE)
        else:
            state = scan.step(ENABLE_PATH.get(state, DriveCommand.DISABLE_VOLTAGE))
        enabled_s = (enabled_s or time.monotonic()) if state is DriveState.OPERATION_ENABLED else None
        if time.monotonic() > until:
            found = state.name.lower().replace("_", " ")
            hint = "check main power, safe torque off and the emergency stop"
            raise DriverError(
                Problem("the drive is not enabled", f"node {config.node_id}", found, "operation enabled", hint)
            )


def timeout_of(config: DriveConfig, protection: str) -> float | None:
    """Return the time-out that supervises something by the profile [s]; None where nothing does."""
    if protection == "setpoint_timeout":
        return config.setpoint_timeout_s if config.profile.torque_pdo.timeout else None
    if config.profile.protections.controller_heartbeat == NONE:
        return None
    return config.controller_heartbeat_timeout_s


def _watch(scan: _Scan, gate: _Withholding, config: DriveConfig, trial: Trial) -> Reaction:
    own = [timeout_of(config, trial.protection)] if trial.protection else _timeouts(config)
    timeouts = [one for one in own if one is not None]
    wait_s = max(LEAST_WAIT_S, WAITS * max(_timeouts(config), default=0.0))
    gate.withheld, gate.emergencies[:] = trial.withheld, []
    began = time.monotonic()
    blind = SYNC in trial.withheld
    acted_s = off_s = None
    seen_enabled_s, state = began, DriveState.OPERATION_ENABLED
    last_word = len(gate.status_words)
    while off_s is None:
        now = time.monotonic()
        if now > (began + wait_s if acted_s is None else acted_s + OFF_MOST_S):
            break
        if blind:
            gate.ask()
        shown = scan.step(DriveCommand.ENABLE_OPERATION)
        now = time.monotonic()
        if blind:
            fresh = gate.status_words[last_word:]
            last_word = len(gate.status_words)
            seen = [(at, decode_state(word)) for at, word in fresh]
        else:
            seen = [(now, shown)] if scan.drive.age_scans(scan.scan) == 0 else []
        for at, one in seen:
            if one is DriveState.OPERATION_ENABLED and acted_s is None:
                seen_enabled_s = at
            elif acted_s is None:
                acted_s, state = at, one
            if acted_s is not None and one in DRIVE_IS_OFF:
                off_s = off_s or at
    since = max(gate.passed_s[kind] for kind in trial.withheld)
    return Reaction(
        trial=trial.id,
        acted=acted_s is not None,
        after_s=(acted_s or time.monotonic()) - since,
        seen_enabled_s=max(seen_enabled_s - since, 0.0),
        state=state,
        off_s=None if off_s is None else off_s - since,
        emcy_code=gate.emergencies[0][1] if gate.emergencies else 0,
        timeout_s=max(timeouts, default=None),
    )


def _timeouts(config: DriveConfig) -> list[float]:
    found = (timeout_of(config, "setpoint_timeout"), timeout_of(config, "controller_heartbeat"))
    return [one for one in found if one is not None]


def _leave(link: CanLink, drive: CanDrive, config: DriveConfig) -> None:
    """Take the drive's power, and end its process data and its supervision of our heartbeat."""
    off = _NO_ORDERS._replace(drive_mode=int(DriveMode.CYCLIC_SYNC_TORQUE))
    drive.send(off, 0)
    for command in (NMT_ENTER_PRE_OPERATIONAL, NMT_RESET_COMMUNICATION):
        link.send_frames(((0, bytes((command, config.node_id))),))


CURES = {
    "setpoints": (
        "This drive may check synchronous PDOs only when a SYNC arrives. In its profile, write 'transmission_type: 255'"
        " (event-driven) on the receive PDOs. If it then still does not stop, write 'timeout:"
        " false': then only the heartbeat protects."
    ),
    "heartbeat": (
        "In protections of its profile, write 'controller_heartbeat: consumer_heartbeat' (0x1016), and check"
        " controller_node_id. If it then still does not stop, write 'none': then only the time-out"
        " of set-points protects."
    ),
    "everything": (
        "This drive keeps its torque when the program ends. No automatic run is allowed. With the drive maker's tool,"
        " set the heartbeat or the time-out of set-points, 0x6007 and 0x605E; or use a drive that has them."
    ),
}
"""What to do about a trial without a reaction."""


def judged(reactions: Sequence[Reaction]) -> tuple[Finding, ...]:
    """Say what the reactions prove and what they do not.

    What a profile declares must act. What it does not declare is said and refuses nothing, as long as a dead controller
    ends the torque.
    """
    findings: list[Finding] = []
    for trial, one in zip(TRIALS, reactions, strict=True):
        declared = trial.protection is None or one.timeout_s is not None
        if not one.acted:
            what = f"{_capital(trial.title)}: the drive stayed enabled for {one.after_s:.2g} s."
            if not declared:
                what += " Its profile declares no supervision."
            findings.append(Finding(what=what, cure=CURES[trial.id], refuses=declared))
        elif one.off_s is None:
            what = f"{_capital(trial.title)}: the drive reacted, and was not without torque {OFF_MOST_S:g} s later."
            findings.append(
                Finding(
                    what=what,
                    cure="Check the drive settings 0x6007, 0x605A and 0x605E (reactions to a stop) in the bench file.",
                )
            )
        elif one.timeout_s is not None and one.seen_enabled_s > LATE * one.timeout_s + GRACE_S:
            seen_ms, set_ms = one.seen_enabled_s * 1e3, one.timeout_s * 1e3
            what = f"{_capital(trial.title)}: still enabled after {seen_ms:.0f} ms, time-out {set_ms:g} ms."
            findings.append(
                Finding(
                    what=what,
                    cure="Another protection of the drive reacted. Compare this setting with the drive's manual.",
                )
            )
    supervised = [one for trial, one in zip(TRIALS, reactions, strict=True) if trial.protection]
    if not any(one.acted for one in supervised):
        what = "Neither set-points nor heartbeat are supervised."
        findings.append(Finding(what=what, cure=CURES["everything"]))
    return tuple(findings)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def figures(reactions: Sequence[Reaction]) -> tuple[Figure, ...]:
    """Return what was measured, for the protocol."""
    told: list[Figure] = []
    for trial, one in zip(TRIALS, reactions, strict=True):
        name = trial.title
        told.append(Figure(name=f"{name}: drive reacts", value=int(one.acted)))
        if one.acted:
            told.append(Figure(name=f"{name}: not enabled after", value=round(one.after_s * 1e3, 1), unit="ms"))
            told.append(Figure(name=f"{name}: last seen enabled", value=round(one.seen_enabled_s * 1e3, 1), unit="ms"))
        if one.off_s is not None:
            told.append(Figure(name=f"{name}: without torque after", value=round(one.off_s * 1e3, 1), unit="ms"))
        if one.emcy_code:
            told.append(
                Figure(
                    name=f"{name}: emergency code", value=f"0x{one.emcy_code:04X}, {explain_emcy(one.emcy_code).cause}"
                )
            )
    return tuple(told)
