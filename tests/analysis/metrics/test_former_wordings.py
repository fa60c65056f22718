"""A better wording of a definition does not part stored results from those of before."""

from __future__ import annotations

import hashlib

from analysis.metrics.former_wordings import FORMER_DEFINITIONS, FORMER_ESTIMATORS, wording_of_today, wordings
from definitions.metrics import METRICS

OF_TODAY = {
    "backlash_width_3pct": "fc7ead91",
    "backlash_width_zero": "cdbb9ad1",
    "backlash_branches_3pct": "ee2549e7",
    "gear_clearance": "fe4a0c89",
    "grade": "45188c61",
    "lost_motion": "61e914e7",
    "stiffness_lsq": "2315160e",
    "stiffness_two_point": "a2ba45d1",
    "stiffness_end_point": "f679f8e7",
    "stiffness_estimate": "bacb77c6",
    "stiffness_50_100": "d1b4f8f6",
    "stiffness_at": "5fe081bd",
    "spring_constant": "37cb1e19",
    "k1": "00f48845",
    "k2": "f9fcf63b",
    "k3": "f8842c6d",
    "hysteresis_energy": "d0ab60ea",
    "hysteresis_angle": "c4ab6a38",
    "windup": "1795e0ed",
    "asymmetry_at_rated": "ea9a515a",
    "torque_ratio_slope": "872e6c91",
    "torque_ratio_offset": "e3c496fd",
}
"""Digest of every definition. Who changes one: put its words of before into `FORMER_DEFINITIONS` where nothing else
changed, or leave them out where another value is computed now; then put the new digest here.
"""


def test_a_definition_is_not_worded_anew_without_keeping_its_words_of_before() -> None:
    assert {name: hashlib.sha256(row.text.encode()).hexdigest()[:8] for name, row in METRICS.items()} == OF_TODAY


def test_every_former_wording_is_that_of_one_metric_and_none_of_today() -> None:
    former = [text for texts in FORMER_DEFINITIONS.values() for text in texts]
    assert FORMER_DEFINITIONS.keys() <= METRICS.keys()
    assert len(former) == len(set(former))
    assert not set(former) & {row.text for row in METRICS.values()}
    assert not FORMER_ESTIMATORS.keys() & {row.estimator for row in METRICS.values()}
    assert set(FORMER_ESTIMATORS.values()) <= {row.estimator for row in METRICS.values()}


def test_words_of_before_say_what_those_of_today_say() -> None:
    for name, texts in FORMER_DEFINITIONS.items():
        now = METRICS[name].text
        assert {wording_of_today(text) for text in (*texts, now)} == {now}
        assert set(wordings(texts[0])) == set(wordings(now)) == {now, *texts}
    assert wordings("something else") == ("something else",)
