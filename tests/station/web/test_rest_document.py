"""Whatever the document of the REST interface allows, and whatever it does not, is answered as it says."""

from __future__ import annotations

import uuid
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from schemathesis import openapi
from schemathesis.generation import GenerationMode
from schemathesis.specs.openapi.checks import positive_data_acceptance

from station.web.actions.table import ACTIONS
from station.web.guard import Guard
from station.web.people.accounts import COOKIE, Person, open_session
from station.web.rest.app import keeper_of, rest_of
from station.web.station import Station

EXAMPLES = 6
"""Of each operation and mode. A scan may be any text, and yet no serial number: that is no broken promise."""


@pytest.fixture(scope="module")
def document(shared_station: Station) -> Any:
    shared_station.evaluations.fork()  # it has loaded most of what evaluates
    app = Guard(rest_of(shared_station, secure=False), ["testserver"], keeper_of(shared_station))
    return openapi.from_asgi("/api/openapi.json", app)


@pytest.mark.parametrize("mode", list(GenerationMode))
def test_an_answer_is_one_that_the_document_tells_of(
    shared_station: Station, document: Any, mode: GenerationMode
) -> None:
    asked = []
    for found in document.get_all_operations():
        operation = found.ok()
        if mode is GenerationMode.NEGATIVE and not operation.body:
            continue  # what is asked without a body can hardly be asked wrongly

        @settings(max_examples=EXAMPLES, derandomize=True, deadline=None, suppress_health_check=list(HealthCheck))
        @given(case=operation.as_strategy(generation_mode=mode))
        def ask(case: openapi.Case) -> None:
            with shared_station.database.writing() as connection:
                session = open_session(connection, Person("the engineer", "engineer"))
            case.headers = {**(case.headers or {}), "Idempotency-Key": uuid.uuid4().hex, "X-CSRF-Token": session.csrf}
            case.cookies = {COOKIE: session.token}
            case.call_and_validate(excluded_checks=[positive_data_acceptance])

        ask()
        asked.append(operation.label)
    assert len(asked) == len(set(asked)) >= len(ACTIONS) + 1
