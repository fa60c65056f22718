"""Set-up of the drive before the scan: prove which drive it is, write every protection, read all of it back, start it.

Blocking, over SDO. Nothing is written to a drive whose identity is wrong; every other finding is collected and told at
once. A drive that fails here is left in pre-operational, where it takes no set-points.
"""

from __future__ import annotations

import time

from definitions.image import NmtState
from definitions.protections import missing_text
from drivers.can.bus import CanLink
from drivers.config import DriveConfig
from drivers.errors import Problem
from drivers.servo_drive.comparison import rows_of
from drivers.servo_drive.mapping import mapping_groups
from drivers.servo_drive.object_setup import NODE_NEXT, ObjectSetup
from drivers.servo_drive.objects import (
    homing_rows,
    identity_rows,
    missing_protections,
    output_rows,
    polarity_rows,
    protection_rows,
    protections_switched_off,
    rating_rows,
    startup_rows,
    synchronisation_rows,
)
from drivers.servo_drive.sdo import (
    NMT_ENTER_PRE_OPERATIONAL,
    NMT_RESET_COMMUNICATION,
    NMT_START,
    SdoFailure,
    SdoNode,
)


def set_up_drive(link: CanLink, config: DriveConfig, period_ns: int) -> list[str]:
    """Make the drive ready for the scan and operational; returns what was verified, one line per object.

    Raises DriveSetupError with all findings.
    """
    return _Setup(link, config, period_ns).run()


class _Setup(ObjectSetup):
    """One pass through the set-up of the drive."""

    def __init__(self, link: CanLink, config: DriveConfig, period_ns: int) -> None:
        node = SdoNode(link, config.node_id, config.sdo_reply_timeout_s, config.sdo_tries)
        super().__init__(node, f"node {config.node_id}", config.setup_timeout_s)
        self.config = config
        self.period_ns = period_ns

    def run(self) -> list[str]:
        self._refuse_switched_off()
        self._refuse_contradictions()
        try:
            self._boot()
            self.check(identity_rows(self.config))
            self.stop_on_problems()
            self.check(rating_rows(self.config))
            alone = [
                *startup_rows(self.config),
                *synchronisation_rows(self.config, self.period_ns),
                *protection_rows(self.config),
                *polarity_rows(),
                *homing_rows(self.config),
                *output_rows(self.config),
            ]
            self.hold([*([row] for row in alone), *mapping_groups(self.config)])
            self.stop_on_problems()
            self._start()
            self.log += [f"{self.who}: {missing_text(one)}" for one in missing_protections(self.config.profile)]
        except SdoFailure as failure:  # of an NMT command: the bus itself failed
            self.find("NMT command not sent", self.who, failure.cause, "sent", failure)
        self.stop_on_problems()
        return self.log

    def _refuse_switched_off(self) -> None:
        for row in protections_switched_off(self.config):
            where = f"{self.who} {row.index:04X}:{row.subindex:02X}"
            self.problems.append(
                Problem(f"{row.meaning} would be switched off", where, "0", "above 0", "correct the bench file")
            )
        self.stop_on_problems()

    def _refuse_contradictions(self) -> None:
        """Refuse a profile that starts the drive up with an object which the set-up writes or checks too."""
        config = self.config
        startup = startup_rows(config)
        taken = [row for row in rows_of(config, self.period_ns) if row not in startup]
        meanings = {(row.index, row.subindex): row.meaning for row in taken}
        for row in startup:
            meaning = meanings.get((row.index, row.subindex))
            if meaning is not None:
                what, expected = f"{row.meaning} is written at start-up", f"an object that is not {meaning}"
                self.problems.append(
                    Problem(what, self.where(row), str(row.value), expected, "delete it from 'startup' of the profile")
                )
        self.stop_on_problems()

    def _boot(self) -> None:
        """Restart the node's communication, so that what it says afterwards is known to be from now."""
        node, wait_s = self.node, self.config.boot_timeout_s
        node.command(NMT_RESET_COMMUNICATION)
        if not node.wait_for(NmtState.BOOT_UP, wait_s):
            self.problems.append(
                Problem(
                    "the drive does not start",
                    self.who,
                    f"no boot-up message within {wait_s:g} s after the reset of its communication",
                    "a boot-up message",
                    NODE_NEXT,
                )
            )
            self.stop_on_problems()
        node.forget_emergencies()
        node.command(NMT_ENTER_PRE_OPERATIONAL)
        deadline = time.monotonic() + wait_s
        while True:  # some drives say boot-up well before they answer
            try:
                node.read(0x1018, 1, "u32")
            except SdoFailure:
                if time.monotonic() > deadline:
                    break
            else:
                break
        self.log.append(f"{self.who}: boot-up message received")

    def _start(self) -> None:
        self.node.command(NMT_START)
        if self.node.wait_for(NmtState.OPERATIONAL, self.config.boot_timeout_s):
            self.log.append(f"{self.who}: started, heartbeat says operational")
            return
        self.problems.append(
            Problem(
                "the drive does not become operational",
                self.who,
                f"NMT states {sorted(set(self.node.heard))} heard within {self.config.boot_timeout_s:g} s",
                "heartbeats with state 5, operational",
                NODE_NEXT,
            )
        )
