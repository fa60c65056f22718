"""Records for the station's tests."""

from __future__ import annotations

from typing import Any

from definitions.image import IMAGE_FIELDS, ORDERS_FIELDS, Image, Orders

IMAGE = Image(*(0.5 * n if field.format == "d" else n for n, field in enumerate(IMAGE_FIELDS)))
ORDERS = Orders(*(0.25 * n if field.format == "d" else n for n, field in enumerate(ORDERS_FIELDS)))

MANIFEST: dict[str, Any] = {
    "recipe": {"name": "r", "revision": 1, "sha256": "0", "file": "r.yaml"},
    "bench": {"name": "b", "revision": 1, "sha256": "0", "file": "b.yaml", "embedded": True},
    "software": {"name": "lostmotion", "version": "0"},
    "unit": {"model": "RV", "virtual": None},
    "scenario": None,
    "operator": None,
    "clock": "real",
    "period_ns": 1_000_000,
    "verdict": None,
    "notes": [],
    "ring": None,
}
"""What the manifest of a run holds beside what the store puts into it."""
