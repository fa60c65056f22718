"""Actions of a jog: begin it, hold and let go of a key, the enabling device of a virtual bench, end it."""

from __future__ import annotations

from station.bench.request import load_job
from station.records.revisions.history import History
from station.run.jog.jogs import jog_job, why_no_jog
from station.web.actions.row import Call, NotNowError
from station.web.actions.values import DevicePressed, JogBegun, KeyHeld, KeyReleased, NewJog, Nothing, Outcome
from station.web.permission import recipe_file

NO_JOG = "No jog was started on this page. Start one first."


def begin_jog(call: Call, given: NewJog) -> JogBegun:
    """Begin a jog: open the bench with the drive off; NotNowError: a run, a recovery or another jog is on."""
    station = call.station
    if station.running.busy():
        raise NotNowError([("bench_free", "A run is in progress. Wait for its end.")])
    if station.jogging.standing().on:
        raise NotNowError([("bench_free", "A jog is on already. End it first.")])
    model = next((one for one in station.models.models if one.model == given.model), None)
    if model is None:
        known = ", ".join(one.model for one in station.models.models)
        raise NotNowError([("model", f"There is no model {given.model[:40]!r}. Known are {known}.")])
    recipe = recipe_file(History(station.data), model.recipe)
    job = jog_job(load_job(recipe, model.bench), given.speed)
    if why := why_no_jog(station.data, job):
        raise NotNowError([("bench_free", why)])
    words = [recipe, *(["--bench", model.bench] if model.bench else []), "--speed", f"{given.speed:g}"]
    words += ["--unit", model.unit] if model.unit else []
    station.jogging.start(words, call.session.token, call.person.name)
    return JogBegun(model=model.model, bench=job.bench.bench.name)


def hold_jog(call: Call, given: KeyHeld) -> Outcome:
    """Hold the key of a direction: what turns the shaft is what the page says while it is held."""
    if not call.station.jogging.hold(call.session.token, given.direction):
        raise NotNowError([("no_jog", NO_JOG)])
    return Outcome()


def release_jog(call: Call, _given: KeyReleased) -> Outcome:
    """Let go of the key; NotNowError: none is held."""
    if not call.station.jogging.release(call.session.token):
        raise NotNowError([("no_key", "No key is held on this page.")])
    return Outcome()


def press_device(call: Call, given: DevicePressed) -> Outcome:
    """Press the enabling device of the embedded virtual bench, or let go; NotNowError: none is jogged."""
    if not call.station.jogging.press(down=given.down):
        words = "No virtual bench is jogged. A real enabling device is pressed by hand."
        raise NotNowError([("no_virtual_bench", words)])
    return Outcome()


def end_jog(call: Call, _given: Nothing) -> Outcome:
    """End the jog: stop, drive off; NotNowError: none is on."""
    if not call.station.jogging.end():
        raise NotNowError([("no_jog", "No jog of this station is on.")])
    return Outcome()
