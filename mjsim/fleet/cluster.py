"""The campaigns of a fleet on a running Dask cluster. Campaigns travel as their files; workers need no shared disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mjsim.batch.cluster import feed
from mjsim.errors import shortened
from mjsim.fleet.jobs import Job, Options, files_of
from mjsim.fleet.one import diagnosed_elsewhere


def run_on_cluster(client: Any, jobs: Sequence[Job], options: Options, deliver: Callable[[Job, dict], None]) -> None:
    """Diagnose all campaigns on the workers of a cluster; ``deliver`` gets each result as it comes.

    Args:
        client: Of :func:`mjsim.batch.cluster.connected`.
        jobs: The campaigns.
        options: How they are diagnosed.
        deliver: Told of each result.
    """

    def submit(job: Job) -> Any:
        return client.submit(diagnosed_elsewhere, files_of(job.folder), options, pure=False, retries=0)

    def take(job: Job, future: Any) -> None:
        deliver(job, {"campaign": job.folder.name, **_result(future), "folder": str(job.folder)})

    feed(client, submit, iter(jobs), take)


def _result(future: Any) -> dict:
    """What a worker has found; that it was lost is a result as well."""
    try:
        return future.result()
    except Exception as error:  # a worker lost for the fourth time, the scheduler gone
        what = shortened(f"the cluster gave it back: {type(error).__name__}: {error}", 400)
        return {"error": what, "seconds": None}
