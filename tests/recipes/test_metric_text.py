"""A single metric as a text: it says what an entry of `metrics` says, and is refused as that is."""

from __future__ import annotations

import pytest

from recipes import MetricWanted, RecipeError, Selection, left_out, parse_recipe, selected, shipped_recipes

RECIPE = parse_recipe(shipped_recipes()["rv-40e-121-inverse"].read_bytes(), "r.yaml")
RATED = 412.0


def one(text: str) -> MetricWanted:
    (found,) = selected(RECIPE, Selection(metrics=(text,)))
    return found


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("asymmetry_at_rated", {}),
        ("stiffness_at torque=25% branch=load", {"torque_nm": 0.25 * RATED, "branch": "load"}),
        ("stiffness_at  torque = 25 %  branch = load", {"torque_nm": 0.25 * RATED, "branch": "load"}),
        ("stiffness_at torque=100 N·m, branch=load", {"torque_nm": 100.0, "branch": "load"}),
        ("id=stiffness_at side=- torque='0.1 kN·m'", {"side": "-", "torque_nm": 100.0}),
        ("lost_motion band=5%", {"band": 0.05}),
        ("spring_constant fit=three_region variant=centred", {"fit": "three_region", "variant": "centred"}),
    ],
)
def test_a_text_says_what_an_entry_of_a_recipe_says(text: str, said: dict[str, object]) -> None:
    found = one(text)
    assert {name: value for name, value in found.model_dump().items() if value is not None} == {
        "id": text.split(maxsplit=1)[0].removeprefix("id="),
        **said,
    }


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("stifness_at", "found the unknown metric 'stifness_at'; allowed: backlash_width_3pct"),
        ("stifness_at", "Did you mean 'stiffness_at'?"),
        ("stiffness_at brunch=load", "brunch: found the unknown option 'brunch'; allowed: id, branch, side"),
        ("stiffness_at brunch=load", "Did you mean 'branch'?"),
        (
            "stiffness_at branch=laod",
            "branch: found 'laod'; allowed: load, unload, mean or width. Did you mean 'load'?",
        ),
        ("windup branch=load", "branch: found 'load' for windup; allowed: mean"),
        ("windup band=5%", "band: found a band for windup; allowed: a band for lost_motion"),
        ("lost_motion band=5", "band: found 5 without a unit"),
        ("lost_motion band=60%", "band: found '60%'; allowed: a fraction such as"),
        ("stiffness_at torque=50 K", "torque: found '50 K', which is a temperature"),
        ("stiffness_at load", "found 'load' without the name of its option; allowed: the metric, then option=value"),
        ("windup windup", "'windup' without the name of its option"),
        ("stiffness_at branch=load branch=mean", "branch: found branch a second time; allowed: each option once"),
        ("windup max=30 arcmin", "max: found a limit, '30 arcmin'; allowed: the limits of the recipe"),
        ("", "id: found nothing; allowed: the option 'id', which is required"),
        ("=5", "found the unknown metric '=5'"),
        ("\x00\x1b[2J" * 30, "found the unknown metric"),
    ],
)
def test_a_text_is_refused_at_its_place(text: str, said: str) -> None:
    with pytest.raises(RecipeError) as refused:
        one(text)
    message = str(refused.value)
    assert message.startswith("--metric '")
    assert said in message
    assert message.isprintable()


def test_the_same_definition_twice_is_refused_and_once_beside_its_preset_is_not() -> None:
    with pytest.raises(RecipeError, match="--metric 'windup variant=fitted': found it a second time"):
        selected(RECIPE, Selection(metrics=("windup", "windup variant=fitted")))
    ids = [metric.id for metric in selected(RECIPE, Selection("measurement", ("windup", "lost_motion")))]
    assert ids == ["backlash_width_3pct", "spring_constant", "windup", "lost_motion"]


def test_limits_of_the_recipe_hold_where_the_definition_is_the_same() -> None:
    assert (one("lost_motion").max, one("lost_motion band=3%").max) == (1.0, 1.0)
    assert one("lost_motion band=4%").max is None
    limited = [metric.id for metric in RECIPE.metrics if (metric.min, metric.max) != (None, None)]
    assert left_out(RECIPE, Selection(metrics=("lost_motion",))) == [one for one in limited if one != "lost_motion"]
    assert left_out(RECIPE, Selection(metrics=("lost_motion band=4%",))) == limited
