"""Set-points of a torque sweep: a sine about a mean torque whose frequency goes up and down, scan by scan.

Within each period the frequency rises evenly from the lowest to the highest and falls back, over a whole number of
cycles, so that periods follow each other without a step in torque or rate. The amplitude grows from zero in the first
cycle and fades in the last one. The sine is a polynomial: the C library's differs between processors by the last bit,
and a record must replay byte for byte.
"""

from __future__ import annotations

from math import floor

from definitions.program import Sweep

TWO_PI = 6.283185307179586

SINE = (1.5707963267948966, -0.6459640975062462, 0.0796926262461670, -0.0046817541353187, 0.0001604411847874)
"""Taylor coefficients of sin(π/2·x) for x, x³, x⁵, x⁷, x⁹: right to 4e-6 up to a quarter of a cycle."""


def sine(cycles: float) -> float:
    """Return the sine of a phase in cycles, the same bits on every processor."""
    quarters = 4.0 * (cycles - floor(cycles))  # 0 … 4
    if quarters >= 2.0:
        return -_half(quarters - 2.0)
    return _half(quarters)


def _half(quarters: float) -> float:
    x = quarters if quarters <= 1.0 else 2.0 - quarters
    square = x * x
    total = 0.0
    for coefficient in reversed(SINE):
        total = total * square + coefficient
    return x * total


class TorqueSweep:
    """How far a sweep is; `advance` moves on by scans, `torque_nm` and `rate_nm_s` are about the mean torque.

    What sweep it is the segment says that is on. So all that changes here is numbers, and they are the whole state.
    """

    __slots__ = ("_period_s", "_scan", "rate_nm_s", "torque_nm")

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self.begin()

    def begin(self) -> None:
        """Start a sweep from its beginning."""
        self._scan = 0
        self.torque_nm = self.rate_nm_s = 0.0

    def is_over(self, sweep: Sweep) -> bool:
        """Say whether the last period is over and the torque is the mean again."""
        return self._scan >= sweep.scans

    def advance(self, sweep: Sweep, scans: int) -> None:
        """Move on by so many scans; those of missed periods count, for the sweep keeps its time."""
        self._scan = scan = min(self._scan + scans, sweep.scans)
        share = (scan % sweep.period_scans) / sweep.period_scans
        falling = share > 0.5
        way = 1.0 - share if falling else share
        # cycles within half a period: at the lowest frequency, and what the rise of the frequency adds
        seconds = sweep.period_scans * self._period_s
        slow, more = sweep.from_hz * seconds, (sweep.to_hz - sweep.from_hz) * seconds
        phase = way * (slow + more * way)
        if falling:
            phase = -phase  # the whole period has a whole number of cycles
        frequency_hz = sweep.from_hz + (sweep.to_hz - sweep.from_hz) * 2.0 * way
        part, growth = self._grown(sweep)
        wave, slope = sine(phase), sine(phase + 0.25)
        self.torque_nm = sweep.amplitude_nm * part * wave
        self.rate_nm_s = sweep.amplitude_nm * (part * TWO_PI * frequency_hz * slope + growth * wave)

    def _grown(self, sweep: Sweep) -> tuple[float, float]:
        """Share of the amplitude, and its change per second; both are continuous, and zero at both ends."""
        fade = 1.0 / (sweep.from_hz * self._period_s)  # scans of the slowest cycle
        place = min(self._scan, sweep.scans - self._scan) / fade
        if place >= 1.0:
            return 1.0, 0.0
        growth = 6.0 * place * (1.0 - place) / (fade * self._period_s)
        return place * place * (3.0 - 2.0 * place), growth if 2 * self._scan < sweep.scans else -growth
