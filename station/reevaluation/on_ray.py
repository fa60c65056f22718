"""Jobs on a Ray cluster: the same function for each run, where one computer is not enough.

A cluster runs any code that reaches it, so a token is required, and without an address it listens on this computer
alone. Every computer of it has the same version of this program, reads the archive, and has the variables in its
environment that `archive.yaml` names.
"""

from __future__ import annotations

import os
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from station.reevaluation.evaluate_one import Job, Outcome, evaluate_one
from station.reevaluation.question import Question, ReevaluationError
from station.reevaluation.workers import MOST_DEATHS, Evaluated

HERE = "local"
"""Address of a cluster that is started on this computer and ends with the command."""

TOKENS = ("RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH")
LOOPBACK = "127.0.0.1"
STORE_BYTES = 100_000_000
"""Of the shared memory of a local cluster: nothing but questions and answers is in it."""

ON_LOOPBACK = {
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # Ray's own way to listen on loopback alone: no other computer can join
    "RAY_raylet_start_wait_time_s": "120",
    "RAY_health_check_failure_threshold": "60",
}
"""How a cluster of this computer alone is started; a busy computer is waited for."""

AHEAD = 4
"""Jobs that are handed out for each processor: enough that none waits."""


def evaluate_on(
    address: str, jobs: Sequence[Job], question: Question, count: int, died: Callable[[Job], None] = lambda _: None
) -> Iterator[Evaluated]:
    """Yield each job with its outcome, in the order in which they end.

    address: HOST:PORT of a cluster, or `local`. count: processes of a local one. died: hears of a job whose process
    died.

    Raises:
        ReevaluationError: Ray is not installed, no token is set, or the cluster cannot be reached.

    """
    ray = _connected(address, count)
    try:
        task = ray.remote(num_cpus=1, max_retries=0)(evaluate_one)
        shared = ray.put(question)
        most = AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
        waiting, deaths = deque(jobs), Counter[str]()
        running: dict[Any, Job] = {}
        while waiting or running:
            while waiting and len(running) < most:
                job = waiting.popleft()
                running[task.remote(job, shared)] = job
            (done, *_), _ = ray.wait(list(running), num_returns=1)
            job = running.pop(done)
            try:
                yield job, ray.get(done)
            except ray.exceptions.RayError as error:
                deaths[job.run] += 1
                died(job)
                if deaths[job.run] < MOST_DEATHS:
                    waiting.appendleft(job)
                else:
                    text = str(error).strip().partition("\n")[0]
                    yield (
                        job,
                        Outcome(job.run, error=f"its process ended {MOST_DEATHS} times without an answer: {text}"),
                    )
    finally:
        ray.shutdown()


def _connected(address: str, count: int) -> Any:
    if not any(os.environ.get(name) for name in TOKENS):
        raise ReevaluationError(
            "--cluster: no token is set. Without a token, anybody on the network can use the cluster. Make one "
            "with 'ray get-auth-token --generate', then set RAY_AUTH_TOKEN or RAY_AUTH_TOKEN_PATH here and on every "
            "computer of the cluster"
        )
    os.environ["RAY_AUTH_MODE"] = "token"
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    if address == HERE:
        os.environ |= ON_LOOPBACK
    try:
        import ray  # noqa: PLC0415 - of the extra `cluster`
        import ray.exceptions  # noqa: PLC0415 - as above
    except ImportError as error:
        raise ReevaluationError(
            "--cluster: the library Ray is not installed. Install it: pip install 'lostmotion[cluster]'"
        ) from error
    named: Any = {"include_dashboard": False, "logging_level": "ERROR", "log_to_driver": False}
    if address == HERE:
        named |= {"address": HERE, "num_cpus": count, "_node_ip_address": LOOPBACK, "object_store_memory": STORE_BYTES}
    else:
        named |= {"address": address}
    try:
        ray.init(**named)
    except Exception as error:  # of any class: Ray raises plain exceptions where a part of it does not start
        cause = " ".join(str(error).split())[:300]
        raise ReevaluationError(
            f"--cluster {address}: this Ray cluster cannot be reached: {cause}. Check the address and the token"
        ) from error
    return ray
