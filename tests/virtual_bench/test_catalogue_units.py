"""Units that are made of the values of a recipe's model: good inside the recipe's limits, bad ones outside."""

from __future__ import annotations

from dataclasses import replace

import pytest
from test_units import torque_ratio_offset, width_3pct

from virtual_bench.config import Catalogue
from virtual_bench.physics.catalogue_units import P1_STIFFNESS_NM_ARCMIN, VARIANTS
from virtual_bench.physics.find_unit import find_unit
from virtual_bench.physics.units import P1

RV_20E = Catalogue("RV-20E-81", 81.0, 167.0, 49.0, 65.0, -5.0)
RV_80E = Catalogue("RV-80E-101", 101.0, 784.0, 196.0, 80.0, -24.0)
RV_320E = Catalogue("RV-320E-185", 185.0, 3136.0, 980.0, 150.0, -90.0)
MODELS = pytest.mark.parametrize("model", [RV_20E, RV_80E, RV_320E], ids=lambda model: model.model)


def test_made_of_the_values_of_p1_the_unit_is_p1():
    friction = Catalogue(P1.model, P1.ratio, P1.rated_torque_nm, 100.0, 94.689, -13.889)
    made = replace(find_unit("catalogue", friction), name=P1.name)
    for name in VARIANTS["catalogue"].__dataclass_fields__:
        assert getattr(made, name) == pytest.approx(getattr(P1, name)), name


@MODELS
def test_a_unit_has_the_torque_stiffness_and_friction_of_its_model(model: Catalogue):
    unit = find_unit("catalogue", model)
    assert (unit.name, unit.model, unit.ratio) == ("catalogue", model.model, model.ratio)
    assert unit.stiffness_positive_nm_per_arcmin == pytest.approx(1.1087 * model.stiffness_nm_per_arcmin, rel=1e-4)
    assert torque_ratio_offset(unit) == pytest.approx(model.loading_offset_nm)
    assert 0.5 < width_3pct(unit) < 1.0


@MODELS
@pytest.mark.parametrize("limit", [0.5, 1.0, 3.0])
def test_backlash_ends_below_the_recipe_s_limit_and_that_of_a_worn_unit_above(model: Catalogue, limit: float):
    asked = replace(model, most={"backlash_width_3pct": limit})
    assert 0.9 * limit < width_3pct(find_unit("catalogue", asked)) < 0.97 * limit
    assert width_3pct(find_unit("catalogue-worn", asked)) > 1.05 * limit


@MODELS
def test_stiffness_ends_above_the_recipe_s_limit(model: Catalogue):
    limit = 1.5 * model.stiffness_nm_per_arcmin
    for metric, figure in P1_STIFFNESS_NM_ARCMIN.items():
        unit = find_unit("catalogue", replace(model, least={metric: limit}))
        likeness = unit.stiffness_positive_nm_per_arcmin / P1.stiffness_positive_nm_per_arcmin
        assert likeness * figure == pytest.approx(1.03 * limit)
    assert find_unit("catalogue", replace(model, least={"torque_ratio_offset": -20.0})) == find_unit("catalogue", model)


def test_bad_units_differ_from_the_good_one_as_those_of_the_table_do():
    assert set(VARIANTS) == {"catalogue", *(f"catalogue-{name}" for name in
                             ("worn", "soft", "tight", "cracked", "loose-lock"))}  # fmt: skip
    good = find_unit("catalogue", RV_80E)
    for name, like in VARIANTS.items():
        bad = find_unit(name, RV_80E)
        assert bad.defect == like.defect
        for field in ("stiffness_positive_nm_per_arcmin", "gap_arcmin", "friction_loading_nm", "lock_holds"):
            ratio = getattr(bad, field) / getattr(good, field)
            assert ratio == pytest.approx(getattr(like, field) / getattr(P1, field)), (name, field)


def test_a_seed_makes_another_unit_of_the_lot():
    assert find_unit("catalogue:3", RV_80E) == find_unit("catalogue:3", RV_80E) != find_unit("catalogue:4", RV_80E)
