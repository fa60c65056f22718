"""From the bench file's words to what the drivers are told."""

from __future__ import annotations

from recipes import parse_bench, shipped_benches
from station.bench.assemble import wire_config
from station.bench.request import Source, find_profile


def test_a_serial_lines_settings_reach_the_driver() -> None:
    path = shipped_benches()["example-socketcan"]
    text = (
        path.read_text(encoding="utf-8").replace("parity: none ", "parity: even ").replace("stopbits: 1", "stopbits: 2")
    )
    bench = parse_bench(text.encode(), str(path))
    names = (bench.drive.profile, bench.amplifier.profile, bench.brake.profile, bench.remote_io.profile)
    profiles = {name: Source.read(find_profile(name, path)) for name in names}
    brake = wire_config(bench, profiles, 1_000_000, None).brake
    assert (brake.transport, brake.serial_port, brake.baudrate) == ("rtu", "/dev/ttyUSB0", 115200)
    assert (brake.parity, brake.stop_bits) == ("E", 2)
