"""The names that a scenario may use, each refused where it stands with those that are allowed.

A misspelt name must never be taken for something that did not happen: `never: {event: gard_open}` would hold always.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from functools import partial
from typing import Annotated

from pydantic import AfterValidator, ValidationInfo
from pydantic_core import PydanticCustomError

from definitions.faults import FAULT_BY_ID
from definitions.image import Command, DriveCommand, State
from virtual_bench.faults.reactions import REACTION_NAMES, REACTIONS, reaction_of
from virtual_bench.faults.vocabulary import FAULTS, Verb

LONGEST_EXCERPT = 60
"""Characters of a name that are repeated in a message."""

Vocabulary = Mapping[tuple[str, str], Verb]

VOCABULARY = "faults"
"""Key of the validation context with the vocabulary of the bench that a scenario is for; without it `FAULTS`."""

TARGETS = tuple(sorted({target for target, _ in FAULTS}))
STATE_NAMES = tuple(state.name.lower() for state in State)
ORDER_NAMES = tuple(command.name.lower() for command in DriveCommand)
COMMAND_NAMES = tuple(command.name.lower() for command in Command if command)
EVENT_NAMES = tuple(sorted(FAULT_BY_ID))


def refusal(found: str, allowed: str, hint: str = "", at: str = "") -> PydanticCustomError:
    """Return the error to raise in a validator; `at` is the option inside the section that the message points to.

    Whoever loads the document knows this type of error, and gives it the place in the file.
    """
    context = {"found": found, "allowed": allowed, "hint": hint, "at": at}
    return PydanticCustomError("refused", "found {found}; allowed: {allowed}. {hint}", context)


def excerpt(name: str) -> str:
    """Return a name in quotes, on one line and cut where it is long."""
    return repr(name if len(name) <= LONGEST_EXCERPT else name[: LONGEST_EXCERPT - 3] + "...")


def one_of(names: Sequence[str]) -> str:
    """Return names as a choice: `a, b or c`."""
    return " or ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def did_you_mean(name: str, names: Sequence[str]) -> str:
    """Return the question about the nearest name, or an empty text when none is near."""
    close = get_close_matches(name[:LONGEST_EXCERPT].lower(), names, n=1)
    return f"Did you mean '{close[0]}'?" if close else ""


def vocabulary_in(info: ValidationInfo) -> Vocabulary:
    """Return the faults that a scenario may name."""
    found: Vocabulary = (info.context or {}).get(VOCABULARY, FAULTS)
    return found


def verb_of(target: str, verb: str, vocabulary: Vocabulary) -> str:
    """Return a verb that a target has. Raises PydanticCustomError with all that it has for any other."""
    if (target, verb) in vocabulary:
        return verb
    verbs = sorted(known for of, known in vocabulary if of == target)
    raise refusal(f"{excerpt(verb)}, which is not a fault of {target}", one_of(verbs), did_you_mean(verb, verbs))


def _one_name(name: str, kind: str, names: tuple[str, ...]) -> str:
    if name not in names:
        raise refusal(f"{excerpt(name)}, which is not {kind}", one_of(names), did_you_mean(name, names))
    return name


def _checked(kind: str, names: tuple[str, ...]) -> AfterValidator:
    """Return the check of a name: one of `names`, of which each is a `kind`."""
    return AfterValidator(partial(_one_name, kind=kind, names=names))


def _target(name: str, info: ValidationInfo) -> str:
    return _one_name(name, "a target", tuple(sorted({target for target, _ in vocabulary_in(info)})))


def _order(name: str) -> str:
    """Check an order, and know a reaction: people read those names first, in messages and reports."""
    if name in ORDER_NAMES or name not in REACTION_NAMES:
        return _one_name(name, "an order", ORDER_NAMES)
    given = one_of([command.name.lower() for command in REACTIONS[reaction_of(name)].orders])
    order = f"or the order that it gives: {given}" if given else "it gives no order"
    hint = f"Write 'reaction: {name}', {order}."
    raise refusal(f"{excerpt(name)}, which is a reaction", one_of(ORDER_NAMES), hint)


Target = Annotated[str, AfterValidator(_target)]
StateName = Annotated[str, _checked("a state", STATE_NAMES)]
EventName = Annotated[str, _checked("a fault of the fault table", EVENT_NAMES)]
ReactionName = Annotated[str, _checked("a reaction", REACTION_NAMES)]
CommandName = Annotated[str, _checked("a command", COMMAND_NAMES)]
OrderName = Annotated[str, AfterValidator(_order)]
