from __future__ import annotations

import pytest
from printed_numbers import alike, prints, reads


@pytest.mark.parametrize(
    ("text", "value", "right"),
    [
        ("−13.929573", -13.9295735000001, True),
        ("−13.929573", -13.9295736, False),
        ("8.88", 8.884999, True),
        ("8.88", 8.886, False),
        ("1.2e-05", 1.249e-5, True),
        ("1.2e-05", 1.26e-5, False),
        ("200", 200.4, True),
        ("200", 201.0, False),
    ],
)
def test_a_printed_number_stands_for_half_a_unit_of_its_last_digit(text: str, value: float, right: bool) -> None:  # noqa: FBT001
    assert prints(text, value) is right


@pytest.mark.parametrize(
    ("text", "right"),
    [
        ("row 4: 1.113 of 60, limit 2", True),
        ("row 4: 1.114 of 60, limit 2", True),
        ("row 4: 1.115 of 60, limit 2", False),
        ("row 4: 1.1130 of 60, limit 2", False),
        ("row 4: 1.113 of 61, limit 2", False),
        ("row 5: 1.113 of 60, limit 2", False),
        ("row 4: 1.113 of 60, limit 25", False),
        ("rows 4: 1.113 of 60, limit 2", False),
    ],
)
def test_words_and_counts_are_read_as_they_are_and_figures_to_their_last_digit(text: str, right: bool) -> None:  # noqa: FBT001
    assert reads(f"before {text}.", "row 4: 1.113 of 60, limit 2") is right


@pytest.mark.parametrize(
    ("other", "same"),
    [
        ({"a": [1, 2.0 + 1e-12, "x"]}, True),
        ({"a": [1, 2.0 + 1e-7, "x"]}, False),
        ({"a": [1, 2, "x"]}, False),
        ({"a": [1, 2.0]}, False),
        ({"b": [1, 2.0, "x"]}, False),
        ({"a": [1, 2.0, "y"]}, False),
    ],
)
def test_plain_data_is_alike_when_its_numbers_are(other: object, same: bool) -> None:  # noqa: FBT001
    assert alike({"a": [1, 2.0, "x"]}, other) is same
