"""What the tests of the budget share: a method, a measured loop with and without noise, and figures of sensors."""

import dataclasses

from reference_unit import FIGURES, RATIO, Bench, ReferenceUnit, bench_trace

from analysis.evaluation.metric_result import MetricResult
from analysis.evaluation.pipeline import analyse
from analysis.loop.method import Method, MetricWanted
from analysis.uncertainty.figures import SensorFigures, TorqueFigures

METHOD = Method(ratio=RATIO, rated_torque_nm=412.0, fixture_stiffness_nm_per_arcmin=1e4)
CALIBRATED = dataclasses.replace(METHOD, output_torque="calibrated")
UNIT = ReferenceUnit()
TRACE = bench_trace(UNIT, 453.2, cycles=2)
QUIET = bench_trace(
    UNIT,
    453.2,
    cycles=2,
    bench=Bench(torque_out_noise_nm=0.0, torque_in_noise_nm=0.0, angle_in_bits=None, angle_out_bits=None),
)
NO_ERRORS = {"gain_fraction": 0.0, "zero_fraction": 0.0, "reversibility_fraction": 0.0, "noise_fraction": 0.0}
CERTIFIED = dataclasses.replace(
    FIGURES,
    torque_in=TorqueFigures(5.0, stated_by="certificate"),
    torque_out=TorqueFigures(1000.0, stated_by="certificate"),
)
NO_NOISE = dataclasses.replace(
    FIGURES,
    torque_in=dataclasses.replace(FIGURES.torque_in, noise_fraction=0.0),
    torque_out=dataclasses.replace(FIGURES.torque_out, noise_fraction=0.0),
)


def metric(name: str, figures: SensorFigures | None, method: Method = METHOD, trace: object = QUIET) -> MetricResult:
    return analyse(trace, method, [MetricWanted(name)], figures=figures).metrics[0]


def contributions(found: MetricResult) -> dict[str, float]:
    return {row.quantity: row.contribution for row in found.headline.budget.rows}
