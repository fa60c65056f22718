"""The file `labels.yaml`: the label printer of a bench, the template for each verdict, and what a scan has to read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from recipes import load_document
from station.atomic_file import open_file, refused
from station.web.labels.template import FIELD, FIELDS, LabelError, Template, parse, unknown_fields

FILE = "labels.yaml"
SHIPPED = Path(__file__).parent / "label.zpl"
LARGEST_TEMPLATE = 1 << 20

ONE_RUN = {"code", "run"}
"""Fields that name one run alone: what is read back of a label must not stand on another one, or on the unit."""

Verdict = Literal["PASS", "FAIL", "NOT DECIDABLE"]


class Printer(BaseModel):
    """Where the printer is. `timeout_s`: longest wait for an answer, and for a label to come out [s]."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    host: str = Field(default="127.0.0.1", min_length=1, max_length=255)
    port: int = Field(default=9100, ge=1, le=65535)
    timeout_s: float = Field(default=5.0, ge=0.2, le=60.0)


class LabelSettings(BaseModel):
    """The file.

    `templates`: file of the template for each verdict that gets a label, beside this file or a whole path. `read_back`:
    text with fields that a scan of the label has to read before the next unit is measured; without it none is asked.
    `virtual_units`: whether units of the virtual bench get labels too, which are of no real unit.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    printer: Printer = Printer()
    templates: dict[Verdict, str] = Field(min_length=1)
    read_back: str | None = Field(default=None, min_length=1, max_length=200)
    virtual_units: bool = False


@dataclass(frozen=True)
class Labels:
    """What a plant has decided about labels, with its templates checked."""

    settings: LabelSettings
    templates: dict[str, Template]


def load_labels(data: Path) -> Labels | None:
    """Return the labels of a data folder, None where it has no `labels.yaml`: then none is printed or asked for.

    Raises:
        RecipeError: with all problems of the file.
        StationError: a template cannot be read or is refused, or has no bar code that reads as `read_back`.

    """
    file = data / FILE
    if not file.exists():
        return None
    settings = load_document(file, LabelSettings)
    if settings.read_back is not None and not ONE_RUN & set(FIELD.findall(settings.read_back)):
        raise LabelError(
            f"{file}: read_back: found {settings.read_back!r}, which several labels can share. Use {{code}} or "
            "{run} in it: they differ for each run"
        )
    templates: dict[str, Template] = {}
    for verdict, name in settings.templates.items():
        path = data / name
        found = templates[verdict] = parse(_text(path), str(path))
        wanted = settings.read_back
        if wanted is not None and not found.holds(wanted):
            has = ", ".join(repr(one) for one in found.bar_codes) or "none"
            raise LabelError(
                f"{path}: no bar code of this label template has the text of read_back, {wanted!r}; its bar codes: "
                f"{has}. Correct the template, or read_back in {FILE}"
            )
    if settings.read_back is not None and (unknown := unknown_fields(settings.read_back)):
        raise LabelError(
            f"{file}: read_back: found {{{unknown[0]}}}, which is not a field of a label; allowed are "
            f"{', '.join(FIELDS)}, and the id of a metric"
        )
    return Labels(settings, templates)


def _text(path: Path) -> str:
    try:
        with open_file(path) as file:
            content = file.read(LARGEST_TEMPLATE + 1)
    except OSError as error:
        raise refused(path, error, "read") from error
    if len(content) > LARGEST_TEMPLATE:
        raise LabelError(
            f"{path}: this file is larger than {LARGEST_TEMPLATE} bytes, so it is no label template. Name another file"
        )
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        raise LabelError(f"{path}: this label template is not UTF-8. Save it as UTF-8") from None
