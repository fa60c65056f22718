"""Records for the station's tests."""

from __future__ import annotations

from controller.image import IMAGE_FIELDS, ORDERS_FIELDS, Image, Orders

IMAGE = Image(*(0.5 * n if field.format == "d" else n for n, field in enumerate(IMAGE_FIELDS)))
ORDERS = Orders(*(0.25 * n if field.format == "d" else n for n, field in enumerate(ORDERS_FIELDS)))
