"""Records for the station's tests."""

from __future__ import annotations

from definitions.image import IMAGE_FIELDS, ORDERS_FIELDS, Image, Orders
from station.documents.manifest import BenchSource, RecipeSource, Setup, Software, Unit

IMAGE = Image(*(0.5 * n if field.format == "d" else n for n, field in enumerate(IMAGE_FIELDS)))
ORDERS = Orders(*(0.25 * n if field.format == "d" else n for n, field in enumerate(ORDERS_FIELDS)))

SETUP = Setup(
    recipe=RecipeSource(name="r", revision=1, sha256="0", file="r.yaml"),
    bench=BenchSource(name="b", revision=1, sha256="0", file="b.yaml", embedded=True),
    software=Software(name="lostmotion", version="0"),
    unit=Unit(model="RV"),
    clock="real",
    period_ns=1_000_000,
)
"""What the manifest of a run holds beside what the store puts into it."""
