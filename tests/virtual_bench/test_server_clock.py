"""The virtual bench in real time: what a computer that holds the process up does to plant and drive."""

from __future__ import annotations

import pytest

from virtual_bench import bench_time
from virtual_bench.config import ServerConfig
from virtual_bench.server import VirtualBench

MS = 1_000_000


@pytest.mark.parametrize(
    ("elapsed_ms", "plant_ms", "excused_ms", "said"),
    [(2, 2, None, []), (60, 60, 60, []), (3000, 500, 500, ["process_stopped"])],
)
def test_plant_and_drive_after_a_standstill(
    server_config: ServerConfig,
    monkeypatch: pytest.MonkeyPatch,
    *,
    elapsed_ms: int,
    plant_ms: int,
    excused_ms: int | None,
    said: list[str],
) -> None:
    logged: list[str] = []
    bench = VirtualBench(server_config, None, lambda event, *_text, **_more: logged.append(event))
    clock_ns = bench.time._wall_ns
    excused: list[int] = []
    monkeypatch.setattr(bench.drive.axis.machine, "excuse_silence", excused.append)
    monkeypatch.setattr(bench_time.time, "monotonic_ns", lambda: clock_ns + elapsed_ms * MS)
    bench.advance()
    assert bench.plant.now_ns == pytest.approx(plant_ms * MS, abs=50_000)
    assert excused == ([] if excused_ms is None else [excused_ms * MS])
    assert logged == said
