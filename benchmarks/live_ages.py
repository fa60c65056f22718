"""How old the newest point on a page is: the page's clock when it has drawn, against the time of the sample.

The page notes each drawing and how many points the loop has then. Which sample a point is, is found afterwards in the
record of the run, in order: page and scan run on the same computer, so their clocks are one.
"""

from __future__ import annotations

import json
import os
import time
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from station.bench.request import stored_job
from station.records.run_record import RunRecord
from station.records.samples.scan_record import RECORD_BYTES
from station.run.screen.live import LiveReader

NOTE_DRAWINGS = """(() => {
  const seen = window.seen = {drawn: [], points: []};
  const note = () => {
    const node = document.querySelector('.nicegui-echart'), chart = node && getElement(node.id.slice(1))?.chart;
    if (!chart) { setTimeout(note, 50); return; }
    let length = 0;
    const set = chart.setOption;
    chart.setOption = function (options, ...rest) {
      const data = options.series && options.series[0] && options.series[0].data;
      if (data) { length = data.length; seen.points = data; }
      return set.call(this, options, ...rest);
    };
    chart.on('rendered', () => {
      const last = seen.drawn[seen.drawn.length - 1];
      if (!last || last[1] !== length) seen.drawn.push([performance.timeOrigin + performance.now(), length]);
    });
  };
  note();
})();"""
"""Only a drawing with new points is noted: with one that has none nothing on the screen is newer."""


class Ages(NamedTuple):
    """Ages of the newest point [ms]: whenever it was drawn, and at any moment while the loop grows; drawings."""

    drawn_ms: np.ndarray
    any_ms: np.ndarray
    drawings: int


def keep_samples(folder: Path, kept: Path) -> bool:
    """Keep the samples of a run that is on: at its end they are packed, and lose the form that a page reads.

    False where none are there yet.
    """
    with suppress(FileNotFoundError):
        os.link(RunRecord(folder).samples, kept)
    return kept.exists()


def samples_of(folder: Path, kept: Path) -> tuple[list[tuple[float, float]], np.ndarray]:
    """Return what each record of a run shows on a loop, and when it was sampled [ms since 1970]."""
    record = RunRecord(folder)
    job = stored_job(record)
    reader = LiveReader(job.program, angle_out=job.bench.sensors.angle_out is not None)
    content = kept.read_bytes()
    shown, at = [], []
    told = json.loads((folder / "scan-report.json").read_bytes())
    offset_ns = time.time_ns() - time.monotonic_ns()
    for begin in range(0, len(content), RECORD_BYTES):
        view = reader.read(content[begin : begin + RECORD_BYTES])
        if view.cycle and view.torque_nm is not None and view.windup_arcmin is not None:
            shown.append((round(view.torque_nm, 2), round(view.windup_arcmin, 4)))
            at.append((told["started_ns"] + offset_ns) / 1e6 + 1000.0 * view.time_s)
    return shown, np.array(at)


def ages_of(seen: dict[str, Any], shown: list[tuple[float, float]], at_ms: np.ndarray) -> Ages:
    """Return how old the newest point was on one page."""
    times, place = [], 0
    for point in seen["points"]:
        while place < len(shown) and shown[place] != tuple(point):
            place += 1
        if place == len(shown):
            raise ValueError(f"point {point} of the page is none of the record")
        times.append(at_ms[place])
    drawn = [(at, times[count - 1]) for at, count in seen["drawn"] if 0 < count <= len(times)]
    fresh = np.array([at - sampled for at, sampled in drawn])
    every = [
        np.arange(at, until, 5.0) - sampled for (at, sampled), (until, _) in pairwise(drawn) if sampled < times[-1]
    ]
    return Ages(fresh, np.concatenate(every) if every else fresh, len(drawn))
