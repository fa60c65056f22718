"""Performance figures, as ratios measured in one run on one machine: `python -m benchmarks`.

Side by side, because nearly each is a command of its own (`python -m benchmarks.NAME`). Simulated units, which several
use, have a room, `simulated`.
"""
