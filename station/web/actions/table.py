"""The table of actions: everything that changes anything, with who may do it, what it needs, and what it does."""

from __future__ import annotations

from station.web.actions import bench, people, recipes, runs
from station.web.actions.row import Action
from station.web.actions.values import (
    AccountAdded,
    AccountChanged,
    Announced,
    BypassAdded,
    BypassEnded,
    ChosenLanguage,
    Confirm,
    DryRunStarted,
    EndedBypass,
    FreshPassword,
    Named,
    NewBadge,
    NewBypass,
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
        Action("start_run", "measure the scanned unit", MAY_START, Start, runs.start_run, RunStarted,
               ("scanned", "retest_reason")),
        Action("ask_permission", "say whether a unit may be measured now, and if not, why", MAY_START, Start,
               runs.ask_permission, Permission, ("scanned",)),
        Action("announce_unit", "say whether a unit passed its previous process step", frozenset({MES}), Announced,
               runs.announce_unit, UnitAnnounced, ("serial", "previous_step")),
        Action("stop_run", "bring the torque to zero and stop the run", EVERYBODY, Nothing, runs.stop_run, Outcome),
        Action("confirm_nok", "confirm that a bad unit is in the NOK box", AT_THE_BENCH, Confirm, runs.confirm,
               RunConfirmed, ("run",)),
        Action("begin_recovery", "begin the recovery after a fault: read the devices, enable nothing", IN_CHARGE,
               Nothing, bench.begin_recovery, RecoveryBegun, tells=("run", "cause")),
        Action("acknowledge_fault", "acknowledge the fault: bring the torque to zero and open the lock", IN_CHARGE,
               Recovery, bench.acknowledge_fault, RecoveryTold, ("recovery",)),
        Action("leave_recovery", "end the recovery and leave the bench as it is", IN_CHARGE, Recovery,
               bench.leave_recovery, RecoveryTold, ("recovery",)),
        Action("add_bypass", "bypass a start condition for some hours", IN_CHARGE, NewBypass, bench.add_bypass,
               BypassAdded, ("condition", "reason", "hours")),
        Action("end_bypass", "end the bypass of a start condition", IN_CHARGE, EndedBypass, bench.end_bypass,
               BypassEnded, ("condition",)),
        Action("save_recipe", "save a recipe as the draft of a revision", IN_CHARGE, RecipeText, recipes.save_recipe,
               RecipeChanged, tells=("name", "revision", "sha256")),
        Action("try_recipe", "try a recipe on the virtual bench, with a unit that has the catalogue values",
               IN_CHARGE | MAY_RELEASE, RecipeTried, recipes.try_recipe, DryRunStarted,
               tells=("name", "revision", "sha256")),
        Action("ask_release", "ask that the draft of a recipe be released", IN_CHARGE, RecipeRevision,
               recipes.ask_release, RecipeChanged, ("name", "revision", "sha256")),
        Action("release_recipe", "release a recipe that another person has written", MAY_RELEASE, RecipeRevision,
               recipes.release_recipe, RecipeChanged, ("name", "revision", "sha256")),
        Action("add_person", "add an account", ADMIN, NewPerson, people.add_person, AccountAdded, ("name", "role")),
        Action("disable_person", "close an account", ADMIN, Named, people.disable_person, AccountChanged, ("name",)),
        Action("reset_person", "reopen an account with a new first password", ADMIN, FreshPassword,
               people.reset_person, AccountChanged, ("name",)),
        Action("assign_badge", "give a person a badge with a PIN", ADMIN, NewBadge, people.assign_badge, AccountChanged,
               ("name",)),
        Action("withdraw_badge", "take a person's badge away", ADMIN, Named, people.withdraw_badge, AccountChanged,
               ("name",)),
        Action("change_pin", "change the PIN of your own badge", EVERYBODY, NewPin, people.change_pin, Outcome),
        Action("test_scanner", "check with the test code that the scanner reads correctly", AT_THE_BENCH,
               Scanned, runs.test_scanner, Outcome),
        Action("change_password", "change your own password", EVERYBODY, NewPassword, people.change_password, Outcome,
               with_first_password=True),
        Action("choose_language", "choose the language of your pages", EVERYBODY, ChosenLanguage,
               people.choose_language, Outcome, ("language",)),
        Action("leave", "end the session", EVERYBODY, Nothing, people.leave, Outcome, with_first_password=True),
    )
}  # fmt: skip
"""Every change of state that anybody can bring about, by its id."""
