"""Playing a model: laws of hysteresis, the closed forms against small steps, and the JSON file."""

import itertools
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_model_identification import reference_loop, small_loop_model

from analysis.models.elements import Compliance, bouc_wen, dahl
from analysis.models.identify import identify
from analysis.models.maxwell_slip import identify_maxwell_slip
from analysis.models.path import PathState
from analysis.models.reducer_model import ReducerModel, model_from_json, model_to_json
from analysis.models.table import MODELS
from analysis.trace.errors import AnalysisError

PLAYABLE = {
    "cubic": {"linear_nm_per_arcmin": 60.0, "cubic_nm_per_arcmin3": 1.0, "angle_offset_arcmin": 0.1},
    "gap_dahl": {
        "stiffness_nm_per_arcmin": 110.0, "soft_zone_arcmin": 0.8, "soft_zone_nm": 100.0, "gap_arcmin": 0.2,
        "gap_torque_nm": 2.0, "friction_nm": 23.0, "presliding_nm_per_arcmin": 2000.0, "angle_offset_arcmin": 0.1,
    },
    "bouc_wen": {
        "linear_nm_per_arcmin": 60.0, "cubic_nm_per_arcmin3": 1.0, "angle_offset_arcmin": 0.1, "friction_nm": 30.0,
        "yield_arcmin": 0.2, "exponent": 1.6, "shape": 0.7,
    },
    "maxwell_slip": {
        "offset_nm": 1.0, "middle_arcmin": 0.1, "slip_1_stiffness": 300.0, "slip_1_yield_arcmin": 0.05,
        "slip_2_stiffness": 40.0, "slip_2_yield_arcmin": 0.4, "spring_1_stiffness": 80.0, "spring_1_from_arcmin": 0.1,
        "spring_1_side": 1.0, "spring_2_stiffness": 70.0, "spring_2_from_arcmin": 0.0, "spring_2_side": -1.0,
    },
}  # fmt: skip

FRICTION_NM = {"cubic": 0.0, "gap_dahl": 23.0, "bouc_wen": 30.0, "maxwell_slip": 15.0 + 16.0}

paths = st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=40).map(np.array)
models = st.sampled_from([ReducerModel(name, values) for name, values in PLAYABLE.items()])


def test_every_model_is_played() -> None:
    assert set(PLAYABLE) == {*MODELS, "maxwell_slip"}


@given(model=models, path=paths, cut=st.integers(0, 40))
def test_playing_in_pieces_is_playing_at_once(model: ReducerModel, path: np.ndarray, cut: int) -> None:
    whole, end = model.play(path)
    first, middle = model.play(path[:cut])
    second, last = model.play(path[cut:], middle)
    assert np.concatenate([first, second]) == pytest.approx(whole, abs=1e-6)
    assert last.angle_arcmin == end.angle_arcmin


@given(model=models, path=paths, parts=st.integers(2, 7))
def test_the_step_may_be_long(model: ReducerModel, path: np.ndarray, parts: int) -> None:
    start = model.play(path[:1])[1]
    fine = np.concatenate([np.linspace(a, b, parts + 1)[1:] for a, b in itertools.pairwise(path)] or [[]])
    torque, _ = model.play(path[1:], start)
    assert model.play(fine, start)[0][parts - 1 :: parts] == pytest.approx(torque, abs=2e-3)


@given(model=models, path=paths)
def test_hysteresis_stays_within_the_friction(model: ReducerModel, path: np.ndarray) -> None:
    low, _ = model.play(np.array([-9.0, *path]))
    high, _ = model.play(np.array([9.0, *path]))
    assert (np.abs(high - low)[1:] <= 2 * FRICTION_NM[model.model] + 1e-6).all()


@given(model=models, low=st.floats(-5, 4), width=st.floats(0.1, 5))
@settings(max_examples=40)
def test_a_closed_loop_never_gives_energy(model: ReducerModel, low: float, width: float) -> None:
    angle = low + 0.5 * width * (1 - np.cos(np.linspace(0, 2 * np.pi, 201)))
    # the small cycles of Bouc–Wen settle slowly
    _, state = model.play(np.tile(angle, 40))
    torque, _ = model.play(angle, state)
    assert np.trapezoid(torque, angle) >= -1e-2


@pytest.mark.parametrize(("exponent", "shape"), [(1.0, 1.0), (0.6, 0.5), (2.5, 0.8), (8.0, 0.6)])
def test_bouc_wen_curve_is_the_differential_equation(exponent: float, shape: float) -> None:
    turned = np.linspace(0.0, 0.6, 601)
    z = bouc_wen(0.1, exponent, shape)(np.array([-0.95]), -0.0 + turned)[:, 0]
    state, found = -0.95, []
    for _ in turned:
        found.append(state)
        for _ in range(20):
            state += 0.001 / 20 / 0.1 * (1 - abs(state) ** exponent * (shape * np.sign(state) + 1 - shape))
    assert z == pytest.approx(np.array(found), abs=2e-3)


def test_bouc_wen_with_exponent_and_shape_one_is_dahl() -> None:
    turned = -np.linspace(0.0, 1.0, 100)
    one = bouc_wen(0.1, 1.0, 1.0)(np.array([0.7]), turned)
    other = dahl(1.0, 10.0)(np.array([0.7]), turned)
    assert one == pytest.approx(other, abs=2e-4)


@given(
    st.tuples(
        st.floats(1, 1e3), st.floats(1e-6, 5), st.floats(1, 500), st.floats(1e-6, 5), st.floats(0.1, 20),
        st.floats(-900, 900),
    )
)  # fmt: skip
def test_compliance_is_inverted(parameters: tuple[float, ...]) -> None:
    *values, torque = parameters
    elastic = Compliance(*values)
    there = np.array([torque])
    assert elastic.torque_nm(elastic.angle_arcmin(there)) == pytest.approx(there, rel=1e-7, abs=1e-7)


def test_exported_model_plays_the_measured_loop() -> None:
    loop = reference_loop()
    for found, most in ((identify(loop, "gap_dahl"), 0.3), (identify_maxwell_slip(loop), 1.5)):
        text = model_to_json(found, unit_under_test="RV-40E-121 P1")
        model = model_from_json(text)
        _, state = model.play(loop.angle_arcmin)
        torque, _ = model.play(loop.angle_arcmin, state)
        assert 100 * np.sqrt(np.mean((torque - loop.torque_nm) ** 2)) / loop.peak_nm == pytest.approx(
            found.residual_pct
        )
        assert 100 * np.abs(torque - loop.torque_nm).max() / loop.peak_nm < most
        document = json.loads(text)
        assert document["unit_under_test"] == "RV-40E-121 P1"
        assert {entry["name"]: entry["value"] for entry in document["parameters"]} == dict(found.values)
        assert all(entry["unit"] for entry in document["parameters"])


def test_a_refused_parameter_is_not_exported() -> None:
    with pytest.raises(AnalysisError, match="not exported: soft_zone_arcmin cannot be separated from stiff"):
        model_to_json(small_loop_model())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"format": "other"}, "expected a JSON object with format"),
        ({"model": "cubix"}, "did you mean cubic"),
        ({"parameters": []}, "missing: linear_nm_per_arcmin"),
        ({"parameters": [3]}, r"parameters\[1\]: found 3"),
        ({"parameters": [{"name": "x", "value": "1"}]}, r"parameters\[1\].value: found '1'"),
        ({"parameters": [{"name": "x", "value": 1}, {"name": "x", "value": 1}]}, "x is there twice"),
        ({"parameters": [{"name": "x", "value": 1}]}, "unknown parameters: x"),
    ],
)
def test_faults_of_a_model_file_are_named(change: dict[str, object], said: str) -> None:
    document = json.loads(model_to_json(identify(reference_loop(), "cubic"))) | change
    with pytest.raises(AnalysisError, match=said) as caught:
        model_from_json(json.dumps(document), "unit.json")
    assert "unit.json" in str(caught.value)


json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["name", "value", "model"]), inner),
    max_leaves=8,
)


@settings(max_examples=100)
@given(
    st.text(max_size=40)
    | st.fixed_dictionaries(
        {
            "format": st.just("lostmotion reducer model"),
            "version": st.just(1),
            "model": st.sampled_from(["cubic", "maxwell_slip"]) | json_values,
            "parameters": st.lists(json_values, max_size=3) | json_values,
        }
    ).map(json.dumps)
)
def test_no_model_file_raises_anything_else(text: str) -> None:
    try:
        assert isinstance(model_from_json(text), ReducerModel)
    except AnalysisError as error:
        assert "model file" in str(error)  # noqa: PT017 - anything else would get through


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"slip_1_stiffness": -1.0, "slip_1_yield_arcmin": 1.0}, "slip_1_stiffness: found -1.0"),
        ({"slip_1_stiffness": 1.0}, "missing: slip_1_yield_arcmin"),
        ({"spring_1_stiffness": 1.0, "spring_1_from_arcmin": 0.0, "spring_1_side": 0.5}, "expected 1 or -1"),
        ({"slip_2_stiffness": 1.0}, "unknown parameters: slip_2_stiffness"),
    ],
)
def test_wrong_elements_are_named(values: dict[str, float], said: str) -> None:
    with pytest.raises(AnalysisError, match=said):
        ReducerModel("maxwell_slip", {"offset_nm": 0.0, "middle_arcmin": 0.0, **values})


def test_angles_and_states_that_cannot_be_played_are_said() -> None:
    model = ReducerModel("gap_dahl", PLAYABLE["gap_dahl"])
    with pytest.raises(AnalysisError, match="angle 2 is nan"):
        model.play(np.array([0.0, np.nan]))
    with pytest.raises(AnalysisError, match="2 dimensions"):
        model.play(np.zeros((2, 2)))
    with pytest.raises(AnalysisError, match="3 hysteresis values; this model has 1"):
        model.play(np.zeros(2), PathState(0.0, np.zeros(3)))
