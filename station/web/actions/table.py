"""The table of actions: everything that changes anything, with who may do it, what it needs, and what it does."""

from __future__ import annotations

from station.web.actions import bench, jog, people, recipes, runs, seen
from station.web.actions.row import Action
from station.web.actions.values import (
    AccountAdded,
    AccountChanged,
    Announced,
    BypassAdded,
    BypassEnded,
    ChosenLanguage,
    Confirm,
    DevicePressed,
    DryRunStarted,
    EndedBypass,
    FreshPassword,
    JogBegun,
    KeyHeld,
    KeyReleased,
    Named,
    NewBadge,
    NewBypass,
    NewJog,
    NewPassword,
    NewPerson,
    NewPin,
    Nothing,
    Outcome,
    Permission,
    RecipeChanged,
    RecipeRevision,
    RecipeText,
    RecipeTried,
    Recovery,
    RecoveryBegun,
    RecoveryTold,
    RunConfirmed,
    RunStarted,
    Scanned,
    Start,
    UnitAnnounced,
)
from station.web.people.accounts import MES, ROLES

EVERYBODY = frozenset(ROLES)
AT_THE_BENCH = frozenset({"operator", "technician", "engineer", "admin"})
IN_CHARGE = frozenset({"technician", "engineer", "admin"})
ADMIN = frozenset({"admin"})
MAY_RELEASE = frozenset({"quality", "engineer", "admin"})

MAY_START = AT_THE_BENCH | {MES}

ACTIONS: dict[str, Action] = {
    row.id: row
    for row in (
        Action("start_run", "measure the scanned unit", MAY_START, Start, runs.start_run, RunStarted, seen.bench,
               ("scanned", "retest_reason"), reaches_out=True),
        Action("ask_permission", "say whether a unit may be measured now, and if not, why", MAY_START, Start,
               runs.ask_permission, Permission, seen.bench, ("scanned",)),
        Action("announce_unit", "say whether a unit passed its previous process step", frozenset({MES}), Announced,
               runs.announce_unit, UnitAnnounced, seen.previous_step, ("serial", "previous_step")),
        Action("stop_run", "bring the torque to zero and stop the run", EVERYBODY, Nothing, runs.stop_run, Outcome,
               seen.bench, reaches_out=True),
        Action("confirm_nok", "confirm that a bad unit is in the NOK box", AT_THE_BENCH, Confirm, runs.confirm,
               RunConfirmed, seen.put_away, ("run",)),
        Action("begin_recovery", "begin the recovery after a fault: read the devices, enable nothing", IN_CHARGE,
               Nothing, bench.begin_recovery, RecoveryBegun, seen.recovery, tells=("run", "cause"), reaches_out=True),
        Action("acknowledge_fault", "acknowledge the fault: bring the torque to zero and open the lock", IN_CHARGE,
               Recovery, bench.acknowledge_fault, RecoveryTold, seen.recovery, ("recovery",), reaches_out=True),
        Action("leave_recovery", "end the recovery and leave the bench as it is", IN_CHARGE, Recovery,
               bench.leave_recovery, RecoveryTold, seen.recovery, ("recovery",), reaches_out=True),
        Action("begin_jog", "begin a jog: open the bench, drive off", IN_CHARGE, NewJog, jog.begin_jog, JogBegun,
               seen.jog, ("model", "speed"), tells=("bench",), reaches_out=True),
        Action("hold_jog", "hold a direction key: the shaft turns while the enabling device is pressed", IN_CHARGE,
               KeyHeld, jog.hold_jog, Outcome, seen.jog, ("direction",)),
        Action("release_jog", "release the direction key of a jog: the shaft stops", IN_CHARGE, KeyReleased,
               jog.release_jog, Outcome, seen.jog, ("why",)),
        Action("press_device", "press or release the enabling device of the virtual bench", IN_CHARGE, DevicePressed,
               jog.press_device, Outcome, seen.jog, ("down",), reaches_out=True),
        Action("end_jog", "end the jog: stop, drive off", EVERYBODY, Nothing, jog.end_jog, Outcome, seen.jog,
               reaches_out=True),
        Action("add_bypass", "bypass a start condition for some hours", IN_CHARGE, NewBypass, bench.add_bypass,
               BypassAdded, seen.bypass, ("condition", "reason", "hours")),
        Action("end_bypass", "end the bypass of a start condition", IN_CHARGE, EndedBypass, bench.end_bypass,
               BypassEnded, seen.bypass, ("condition",)),
        Action("save_recipe", "save a recipe as the draft of a revision", IN_CHARGE, RecipeText, recipes.save_recipe,
               RecipeChanged, seen.revision, tells=("name", "revision", "sha256"), reaches_out=True),
        Action("try_recipe", "try a recipe on the virtual bench, with a unit that has the catalogue values",
               IN_CHARGE | MAY_RELEASE, RecipeTried, recipes.try_recipe, DryRunStarted, seen.dry_run,
               tells=("name", "revision", "sha256"), reaches_out=True),
        Action("ask_release", "ask that the draft of a recipe be released", IN_CHARGE, RecipeRevision,
               recipes.ask_release, RecipeChanged, seen.revision, ("name", "revision", "sha256"), reaches_out=True),
        Action("release_recipe", "release a recipe that another person has written", MAY_RELEASE, RecipeRevision,
               recipes.release_recipe, RecipeChanged, seen.revision, ("name", "revision", "sha256"), reaches_out=True),
        Action("add_person", "add an account", ADMIN, NewPerson, people.add_person, AccountAdded, seen.account,
               ("name", "role")),
        Action("disable_person", "close an account", ADMIN, Named, people.disable_person, AccountChanged,
               seen.account, ("name",)),
        Action("reset_person", "reopen an account with a new first password", ADMIN, FreshPassword,
               people.reset_person, AccountChanged, seen.account, ("name",)),
        Action("assign_badge", "give a person a badge with a PIN", ADMIN, NewBadge, people.assign_badge,
               AccountChanged, seen.badge,
               ("name",)),
        Action("withdraw_badge", "take a person's badge away", ADMIN, Named, people.withdraw_badge, AccountChanged,
               seen.badge,
               ("name",)),
        Action("change_pin", "change the PIN of your own badge", EVERYBODY, NewPin, people.change_pin, Outcome,
               seen.own_badge),
        Action("test_scanner", "check with the test code that the scanner reads correctly", AT_THE_BENCH,
               Scanned, runs.test_scanner, Outcome, seen.scanner_test),
        Action("change_password", "change your own password", EVERYBODY, NewPassword, people.change_password,
               Outcome, seen.own_account,
               with_first_password=True),
        Action("choose_language", "choose the language of your pages", EVERYBODY, ChosenLanguage,
               people.choose_language, Outcome, seen.language, ("language",)),
        Action("leave", "end the session", EVERYBODY, Nothing, people.leave, Outcome, seen.session,
               with_first_password=True),
    )
}  # fmt: skip
"""Every change of state that anybody can bring about, by its id."""
