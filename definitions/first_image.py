"""The process image before the first scan of a bench, which writes it in place from then on."""

from __future__ import annotations

from typing import Any

from definitions.image import AGE_NEVER, IMAGE_FIELDS, Image, NmtState, SampleStatus

BEFORE_ANYTHING: dict[str, Any] = {
    "drive_nmt_state": int(NmtState.OPERATIONAL),
    "drive_heartbeat_age_scans": 0,
    "sample_status": int(SampleStatus.NOT_READY),
}
"""What is neither zero nor an age of something that has never come."""


def first_image() -> Image:
    """Return the image before anything has arrived; of the drive a heartbeat has been heard."""
    ages = {field.name: AGE_NEVER for field in IMAGE_FIELDS if field.name.endswith("_age_scans")}
    zeroes = {field.name: 0.0 if field.format == "d" else 0 for field in IMAGE_FIELDS}
    return Image(**zeroes | ages | BEFORE_ANYTHING)
