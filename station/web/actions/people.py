"""Actions about people: accounts, passwords, badges, languages, and the end of a session."""

from __future__ import annotations

from station.web.actions.row import Call
from station.web.actions.values import (
    AccountAdded,
    AccountChanged,
    ChosenLanguage,
    FreshPassword,
    Named,
    NewBadge,
    NewPassword,
    NewPerson,
    NewPin,
    Nothing,
    Outcome,
)
from station.web.people import accounts, badges
from station.web.people.accounts import AccountError


def add_person(call: Call, given: NewPerson) -> AccountAdded:
    """Add an account."""
    accounts.add_person(call.connection, given.name, given.role, given.password)
    return AccountAdded(name=given.name, role=given.role)


def disable_person(call: Call, given: Named) -> AccountChanged:
    """Close an account; AccountError: it is the person's own."""
    if given.name == call.person.name:
        raise AccountError("name: you cannot close your own account. Another admin has to close it")
    accounts.disable_person(call.connection, given.name)
    return AccountChanged(name=given.name)


def reset_person(call: Call, given: FreshPassword) -> AccountChanged:
    """Open an account again with a first password; AccountError: it is the person's own."""
    if given.name == call.person.name:
        raise AccountError("name: this is your own account. Change your own password with change_password")
    accounts.reset_person(call.connection, given.name, given.password)
    return AccountChanged(name=given.name)


def change_password(call: Call, given: NewPassword) -> Outcome:
    """Change the person's own password."""
    accounts.change_password(call.connection, call.person.name, given.old_password, given.new_password)
    return Outcome()


def assign_badge(call: Call, given: NewBadge) -> AccountChanged:
    """Give a person a badge with a PIN."""
    badges.assign_badge(call.connection, given.name, given.badge, given.pin)
    return AccountChanged(name=given.name)


def withdraw_badge(call: Call, given: Named) -> AccountChanged:
    """Take a person's badge away."""
    badges.withdraw_badge(call.connection, given.name)
    return AccountChanged(name=given.name)


def change_pin(call: Call, given: NewPin) -> Outcome:
    """Change the PIN of the person's own badge."""
    badges.change_pin(call.connection, call.person.name, given.password, given.pin)
    return Outcome()


def choose_language(call: Call, given: ChosenLanguage) -> Outcome:
    """Choose the language of the person's pages."""
    accounts.choose_language(call.connection, call.person.name, given.language)
    return Outcome()


def leave(call: Call, _given: Nothing) -> Outcome:
    """End the session."""
    accounts.leave(call.connection, call.session.token)
    return Outcome()
