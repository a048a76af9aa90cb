"""Command-line arguments that choose processes, threads or a cluster for a command's large work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import tyro

from mhsb_model.command_line import JobCount, UsageError
from mhsb_planner.cluster import Cluster
from mhsb_planner.workers import Jobs

Scheduler = Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")]
"""Type of the argument `--scheduler`."""


def parse_jobs(jobs: int | None, scheduler: str | None) -> Jobs:
    """Interpret the arguments `--jobs` and `--scheduler`.

    Args:
        jobs: Number of processes or threads; None: one for each processor.
        scheduler: Address of a Dask cluster; None: this machine.

    Returns:
        The cluster if a scheduler is given, after a connection test; otherwise `jobs`.

    Raises:
        UsageError: Both are given.
        ClusterError: The cluster cannot be used.
    """
    if scheduler is None:
        return jobs
    if jobs is not None:
        raise UsageError("--jobs: a cluster has its workers; leave it out with --scheduler")
    return Cluster.connect(scheduler)


@dataclass(frozen=True)
class WorkArguments:
    """Options for who does the large work of a command: processes or a cluster.

    Attributes:
        jobs: Processes; as many as there are processors when left out.
        scheduler: Address of a Dask cluster that does the work instead (docs/cluster.md).
    """

    jobs: JobCount = None
    scheduler: Scheduler = None

    def connect(self) -> Jobs:
        """Return the number of processes or the cluster, see `parse_jobs`.

        Raises:
            UsageError: `jobs` is below 1, or both are given.
            ClusterError: The cluster cannot be used.
        """
        if self.jobs is not None and self.jobs < 1:
            raise UsageError(f"--jobs: {self.jobs} is below 1")
        return parse_jobs(self.jobs, self.scheduler)
