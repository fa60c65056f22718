"""Fixtures of the virtual bench's tests."""

from __future__ import annotations

import pytest
from virtual_bench_example import example_bench_config, example_output_config, example_server_config

from virtual_bench.config import BenchConfig, ServerConfig


@pytest.fixture(scope="session")
def bench_config() -> BenchConfig:
    """Return the default bench: servo at the input, brake at the output."""
    return example_bench_config()


@pytest.fixture(scope="session")
def output_config() -> BenchConfig:
    """Servo and gearbox at the output, brake at the input."""
    return example_output_config()


@pytest.fixture
def server_config() -> ServerConfig:
    """Return the default bench on free loopback ports."""
    return example_server_config()
