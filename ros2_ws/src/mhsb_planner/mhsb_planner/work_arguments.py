"""The arguments by which commands say who does their large work."""

from __future__ import annotations

from typing import Annotated

import tyro

from mhsb_model.command_line import UsageError
from mhsb_planner.cluster import Cluster
from mhsb_planner.workers import Jobs

Scheduler = Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")]
"""Type of `--scheduler`."""


def jobs_of(jobs: int | None, scheduler: str | None) -> Jobs:
    """What `--jobs` and `--scheduler` say; raises UsageError, ClusterError."""
    if scheduler is None:
        return jobs
    if jobs is not None:
        raise UsageError("--jobs: a cluster has its workers; leave it out with --scheduler")
    return Cluster.at(scheduler)
