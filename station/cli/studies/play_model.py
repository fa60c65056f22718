"""`lostmotion play-model`: wind-ups in, torques out, by an exported model of a reducer."""

from __future__ import annotations

import csv
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

import numpy as np

from analysis.models.reducer_model import ReducerModel, model_from_json
from recipes import open_regular
from station.cli.csv_columns import read_csv_columns
from station.cli.out_file import refuse_records, writing
from station.errors import StationError

ANGLES = {"angle_arcmin": 1.0, "angle_out_arcmin": 1.0, "angle_out_rad": 10800.0 / math.pi}
"""Columns that wind-ups are taken from, the first one found, and their factor to arcmin."""


def play_model(file: Path, angles: Path, out: Path | None, *, as_json: bool) -> int:
    """Play an exported model along wind-ups of a CSV file; write angle and torque as CSV. Return 0.

    Raises:
        StationError, AnalysisError: a file that cannot be read, or what is wrong in it.

    """
    if out is not None:
        refuse_records(out)
    try:
        with open_regular(file) as stream:
            text = stream.read().decode()
    except (OSError, UnicodeError) as error:
        raise StationError(
            f"model file {file} cannot be read: {getattr(error, 'strerror', None) or error}. Name another file"
        ) from error
    reducer: ReducerModel = model_from_json(text, str(file))
    table = read_csv_columns(angles)
    column = next((name for name in ANGLES if name in table.columns), None)
    if column is None:
        raise StationError(f"{angles}: found columns {', '.join(table.columns)}; expected one of {', '.join(ANGLES)}")
    angle = np.array(table.numbers(column)) * ANGLES[column]
    torque, _ = reducer.play(angle)
    if as_json:
        document = {"model": reducer.model, "angle_arcmin": angle.tolist(), "torque_nm": torque.tolist()}
        sys.stdout.write(json.dumps(document, allow_nan=False) + "\n")
        return 0
    if out is None:
        _write(sys.stdout, angle.tolist(), torque.tolist())
        return 0
    with writing(out), out.open("w", encoding="utf-8", newline="") as stream:
        _write(stream, angle.tolist(), torque.tolist())
    sys.stdout.write(f"{out}: {angle.size} torques of model {reducer.model}\n")
    return 0


def _write(stream: TextIO, angle_arcmin: Sequence[float], torque_nm: Sequence[float]) -> None:
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("angle_arcmin", "torque_nm"))
    writer.writerows((f"{x:.9g}", f"{y:.9g}") for x, y in zip(angle_arcmin, torque_nm, strict=True))
