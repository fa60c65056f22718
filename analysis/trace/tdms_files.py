"""NI TDMS files as tables: the channels of one group are the columns; waveform channels bring their own time.

Read through npTDMS, which trusts what a file says about itself; what would not fit the file is refused before any
memory is taken for it.
"""

from __future__ import annotations

import io
import logging
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from nptdms import TdmsFile
from nptdms.log import log_manager

from analysis.trace.errors import AnalysisError

TIME_COLUMN = "t_s"

UNIT_PROPERTY = "unit_string"
"""Property of a channel that says its unit."""

LARGEST_STEP_S = 1e6
"""A waveform with a longer sample period is taken for a damaged one."""


def read_tdms_table(file: Path, known: frozenset[str]) -> Any:
    """Read the group that holds known columns to a table (pyarrow) of its channels, with t_s if it can be told.

    known: names of columns that a trace can have. Raises AnalysisError for a file that npTDMS cannot read, that
    claims more values than it has bytes or was cut off, no group or more than one with known channels, channels of
    different length or of a kind that is no column.
    """
    # it prints pieces of a damaged file to the terminal; what it warns of is refused and named here
    log_manager.set_level(logging.CRITICAL)
    try:
        content = file.read_bytes()
        with TdmsFile.read_metadata(io.BytesIO(content)) as metadata:
            _check_claims(metadata, len(content), file)
        with TdmsFile.open(io.BytesIO(content)) as tdms:
            channels = _chosen_group(tdms, known, file).channels()
            return _table(channels, file)
    except AnalysisError:
        raise
    except Exception as error:
        # npTDMS parses without checks: a damaged file can raise anything from struct.error to UnicodeDecodeError
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise AnalysisError(
            f"{file}: cannot be read as TDMS: {reason:.200}; save the recording again, or export it as CSV"
        ) from error


def _check_claims(metadata: Any, size: int, file: Path) -> None:
    """Refuse a file that says it holds more values than it has bytes, or that ends before its recording."""
    for group in metadata.groups():
        for channel in group.channels():
            if len(channel) > size:
                raise AnalysisError(
                    f"{file}: group {group.name}, channel {channel.name} claims {len(channel)} values in a file of "
                    f"{size} bytes; the file is damaged or cut off; save the recording again"
                )
    if metadata.file_status.incomplete_final_segment:
        raise AnalysisError(
            f"{file}: the recording ends within its last segment: the file was cut off, or never closed; record again"
        )


def _chosen_group(tdms: Any, known: frozenset[str], file: Path) -> Any:
    """Return the only group with channels that a trace knows."""
    there = {group.name: [channel.name.strip() for channel in group.channels()] for group in tdms.groups()}
    chosen = [name for name, channels in there.items() if known.intersection(channels)]
    if len(chosen) == 1:
        return tdms[chosen[0]]
    found = "; ".join(f"group {name}: {', '.join(channels) or 'no channels'}" for name, channels in there.items())
    if chosen:
        raise AnalysisError(f"{file}: found known channels in groups {', '.join(chosen)}; keep one group per file")
    raise AnalysisError(
        f"{file}: found {found or 'no groups'}; expected a group with some of "
        f"{', '.join(sorted(known))}; give the channels these names"
    )


def _table(channels: list[Any], file: Path) -> Any:
    """Return the channels as columns of one length; time from the waveform where no channel brings it."""
    columns: dict[str, Any] = {}
    for channel in channels:
        name = channel.name.strip()
        if name in columns:
            raise AnalysisError(f"{file}: channel {name} is there twice; keep one of them")
        columns[name] = _column(channel[:], name, file)
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{name} has {length}" for name, length in lengths.items())
        raise AnalysisError(f"{file}: {found} values; every channel needs the same number of values")
    steps = {channel.name.strip(): _step_s(channel) for channel in channels}
    timed = {name: step for name, step in steps.items() if step is not None}
    if TIME_COLUMN not in columns and timed:
        if len(set(timed.values())) > 1:
            found = ", ".join(f"{name} has {step} s" for name, step in timed.items())
            raise AnalysisError(
                f"{file}: sampling intervals (wf_increment) differ: {found}; record all channels at one rate, "
                "or resample them"
            )
        step = next(iter(timed.values()))
        _check_starts([channel for channel in channels if channel.name.strip() in timed], step, file)
        columns[TIME_COLUMN] = pa.array(step * np.arange(next(iter(lengths.values()))))
    units = {channel.name.strip(): str(channel.properties.get(UNIT_PROPERTY, "")) for channel in channels}
    fields = [pa.field(name, made.type, metadata={"unit": units.get(name, "")}) for name, made in columns.items()]
    return pa.table(list(columns.values()), schema=pa.schema(fields))


def _check_starts(channels: list[Any], step_s: float, file: Path) -> None:
    """Refuse waveforms that begin at different times: their rows do not belong together."""
    starts = {channel.name.strip(): _start_us(channel) for channel in channels}
    stamped = {name: stamp + offset for name, (stamp, offset) in starts.items() if stamp is not None}
    begins = stamped or {name: offset for name, (_, offset) in starts.items()}
    first, last = min(begins, key=lambda name: begins[name]), max(begins, key=lambda name: begins[name])
    apart_s = (begins[last] - begins[first]) * 1e-6
    if apart_s > step_s:
        raise AnalysisError(
            f"{file}: channel {last} begins {apart_s:.3g} s after channel {first} (wf_start_time, wf_start_offset); "
            "expected all channels from one time on, because the values of a row belong together; record all channels "
            "in one task, or resample them"
        )


def _start_us(channel: Any) -> tuple[int | None, int]:
    """Time stamp at which a waveform begins, None without one, and the offset from it, µs."""
    stamp, offset = channel.properties.get("wf_start_time"), channel.properties.get("wf_start_offset")
    there = isinstance(stamp, np.datetime64) and not np.isnat(stamp)
    number = isinstance(offset, int | float) and not isinstance(offset, bool) and abs(offset) < LARGEST_STEP_S
    return int(stamp.astype("datetime64[us]").astype(np.int64)) if there else None, round(offset * 1e6) if number else 0


def _column(values: Any, name: str, file: Path) -> Any:
    """Return the values of a channel as numbers or text; a channel of times counts in seconds from its first value."""
    array = np.asarray(values)
    if array.ndim == 1 and array.dtype.kind in "iufb":
        return pa.array(array.astype(np.float64))
    if array.ndim == 1 and array.dtype.kind == "M":
        if array.size and np.isnat(array).any():
            raise AnalysisError(f"{file}: channel {name} has rows without a valid time; expected a time in every row")
        seconds = (array - array[:1]).astype("timedelta64[ns]").astype(np.float64) * 1e-9
        return pa.array(seconds)
    if array.ndim == 1 and array.dtype.kind in "OUS":
        return pa.array([str(value) for value in array.tolist()], type=pa.string())
    raise AnalysisError(f"{file}: channel {name} holds {array.dtype}; expected numbers, times or text")


def _step_s(channel: Any) -> float | None:
    """Sample period of a waveform [s], None when there is none that can be believed."""
    step = channel.properties.get("wf_increment")
    if not isinstance(step, int | float) or isinstance(step, bool):
        return None
    return float(step) if math.isfinite(step) and 0.0 < step < LARGEST_STEP_S else None
