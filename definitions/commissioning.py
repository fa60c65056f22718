"""The steps by which a new bench is commissioned: what each proves, what it needs, and when it is due again.

One row per step, in the order in which they are done: a step is refused until all those before it have passed. `parts`
are the entries of bench file and profiles that its result depends on, as the beginnings of their dotted names
(`drive.node_id`, `drive profile.scaling`); when one of these has changed since, the step is due again.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

Power = Literal["off", "enabled, no torque", "torque behind a verified lock"]


class Step(NamedTuple):
    """One step. `needs`: what has to be there for it; `power`: what the drive does meanwhile.

    `parts`: what of bench file and profiles its result depends on; `but`: entries among these that it does not.
    by_recipe: it takes the ratings, or the scan period, of a recipe.
    """

    id: str
    title: str
    proves: str
    needs: str
    power: Power
    parts: tuple[str, ...]
    but: tuple[str, ...] = ()
    by_recipe: bool = False


DRIVE = ("can", "drive", "drive profile")
NOT_ON_THE_WIRES = ("drive.reversed", "drive.angle_agreement_rad", "drive.coupling_stiffness_nm_per_arcmin")
"""Entries of the drive that only a motion shows."""

NOT_PROVEN = ("drive profile.tried_on_hardware",)
"""What somebody states of a profile."""

AMPLIFIER = (
    *("amplifier", "amplifier profile", "devices", "devices profile", "can_devices", "can_devices profile"),
    *("channels", "sensors"),
)
"""What measures: one amplifier, or the devices that `channels` name."""

BRAKE = ("brake", "brake profile", "drive_brake")
REMOTE_IO = ("remote_io", "remote_io profile")
MOTION = ("bench.loading", *DRIVE, *AMPLIFIER, *BRAKE)

# fmt: off
STEPS: tuple[Step, ...] = (
    Step("probe", "Devices and objects",
         "The devices are those of the profiles; the drive holds or takes every object that a run sets",
         "All devices switched on. The unit may be absent", "off",
         (*DRIVE, *AMPLIFIER, *BRAKE, *REMOTE_IO), ("sensors", *NOT_ON_THE_WIRES, *NOT_PROVEN)),
    Step("registers", "Register map of the amplifier",
         "Word order, type and channel of each measured value",
         "Somebody who presses on each torque sensor", "off",
         AMPLIFIER),
    Step("io", "Contacts of the safety chain",
         "Emergency stop and guard are wired to the inputs that the profile names",
         "Somebody at the emergency stop, the guard and, where there is one, the enabling device", "off",
         REMOTE_IO),
    Step("direction", "Signs of motor, torques and angles",
         "Torque and angle of motor and sensors count the same way, and about the right amount",
         "A unit on the bench, clamped at both shafts", "torque behind a verified lock",
         MOTION, NOT_PROVEN, by_recipe=True),
    Step("latency", "Age and lag of the channels",
         "Samples are as fresh, and lag as much, as the bench file says",
         "A unit on the bench, clamped at both shafts", "torque behind a verified lock",
         MOTION, NOT_PROVEN, by_recipe=True),
    Step("watchdogs", "Watchdogs of the drive",
         "The drive ends its torque by itself when the controller is silent",
         "Shafts that may turn freely: the lock is open", "enabled, no torque",
         DRIVE, (*NOT_ON_THE_WIRES, *NOT_PROVEN)),
    Step("tune", "Gain of the torque loop",
         "A torque step is followed without oscillation, also at twice the gain",
         "A unit on the bench, clamped at both shafts", "torque behind a verified lock",
         (*MOTION, "torque_control", "fixture"), NOT_PROVEN, by_recipe=True),
    Step("timing", "Timing of this computer",
         "This computer keeps the scan period with these devices",
         "All devices switched on", "off",
         ("can", "amplifier", "devices", "can_devices", "channels", "brake", "remote_io"), by_recipe=True),
)
# fmt: on

CHANGED, UNFINISHED = "bench changed since it was commissioned", "bench not commissioned to the end"
"""How the note of a result begins whose bench file or profiles are not those that every step passed with."""

STEP_BY_ID = {step.id: step for step in STEPS}

NOT_COMMISSIONED = {
    "bench": "name and revision of the bench do not describe its hardware; commissioning steps that depend on the "
    "loaded shaft name it themselves",
    "jog": "the limits of the jog (a technician turns the shaft) are written into the drive and read back before "
    "every jog",
    "pace": "only a virtual (simulated) bench has this section",
    "calibrations": "torque ratios are measured by test runs, and each has its own due date",
    "master_parts": "master parts are reference reducers, not hardware of the bench",
}
"""Sections of a bench file that no step depends on as a whole, and why."""


def concerns(step: Step, part: str) -> bool:
    """Tell whether the result of a step depends on an entry of bench file or profiles."""

    def inside(names: tuple[str, ...]) -> bool:
        return any(part == name or part.startswith((f"{name}.", f"{name}[")) for name in names)

    return inside(step.parts) and not inside(step.but)
