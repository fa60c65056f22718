"""exp(−y) for y of 0 or more, with the same bits on every computer.

The bench is a loop: where the last bit of one number is another, some encoder shows another count a moment later, and
the run has other samples. Libraries take the `exp` that is fastest on the processor they find, and these differ in the
last bit. Here are additions, multiplications and comparisons alone, which IEEE 754 rounds in one way.

Source: reduction by parts of ln 2 as in P. T. P. Tang, Table-driven implementation of the exponential function in IEEE
floating-point arithmetic, ACM Transactions on Mathematical Software 15 (1989), 144; then the series of Taylor.
"""

from __future__ import annotations

from decimal import Decimal, localcontext
from typing import Any

import numpy as np
import numpy.typing as npt

LARGEST = 700.0
"""Beyond it nothing is left, 1e-304: 0."""

PARTS_BITS = 5
PARTS = 1 << PARTS_BITS
"""The reduction goes by this part of ln 2."""

PARTS_IN_ONE = 46.16624130844683
"""32 / ln 2: parts in a y of one."""

PART_HIGH = float.fromhex("0x1.62E42FEEp-6")
"""ln 2 / 32 to 33 bits: its product with a number of parts, 15 bits, is exact."""

PART_LOW = 5.9631716539705866e-12
"""What ln 2 / 32 is more than that."""

HALVES = np.ldexp(1.0, -np.arange(int(LARGEST * PARTS_IN_ONE) // PARTS + 2))
"""Powers of one half."""


def _roots() -> npt.NDArray[np.float64]:
    with localcontext() as exact:
        exact.prec = 40
        return np.array([float((-Decimal(2).ln() * part / PARTS).exp()) for part in range(PARTS)])


ROOTS = _roots()
"""2 to the power of −n/32."""


def series(r: Any) -> Any:
    """Return exp(−r) for |r| up to ln 2 / 64, of a number or of each one of an array.

    In pairs, which a processor computes side by side. The first term that is left out is below 1e-17.
    """
    rr = r * r
    return (1.0 - r) + rr * ((1 / 2 - r * (1 / 6)) + rr * ((1 / 24 - r * (1 / 120)) + rr * (1 / 720)))


def decay(y: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return exp(−y), within 4e-16 of it, of each number of an array; each is 0 or more."""
    bounded = np.minimum(y, LARGEST)
    parts = (bounded * PARTS_IN_ONE + 0.5).astype(np.int64)
    left = bounded - parts * PART_HIGH - parts * PART_LOW
    scale = ROOTS.take(parts & (PARTS - 1)) * HALVES.take(parts >> PARTS_BITS)  # to divide would take longest of all
    found: npt.NDArray[np.float64] = np.where(y < LARGEST, series(left) * scale, 0.0)
    return found


def decay_of(y: float) -> float:
    """Return exp(−y) of one number of 0 or more, with the bits of `decay`; what is no number stays none.

    The plant's kernel has it compiled.
    """
    at = y * PARTS_IN_ONE + 0.5
    if at < 1.0:  # most of them: no part to take off
        return float(series(y))
    if not y < LARGEST:
        return 0.0 if y >= LARGEST else y
    parts = int(at)
    scale = ROOTS[parts & (PARTS - 1)] * HALVES[parts // PARTS]
    return float(series(y - parts * PART_HIGH - parts * PART_LOW) * scale)
