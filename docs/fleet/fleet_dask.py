"""Adds the captures of a fleet to a lake, with Dask: the tasks of fleet_job.py, on the cores of this machine or of a cluster.

    python3 fleet_dask.py CAPTURES LAKE [--bus FILE] [--machine-from REGEX] [--cobscope PROGRAM] [-- OPTION…]

The environment variable DASK_SCHEDULER_ADDRESS names a cluster. fleet_job.py must be in the same folder.
"""

import os
import sys

import dask.config
from dask.distributed import Client, LocalCluster

import fleet_job


def main():
    job = fleet_job.job_of(sys.argv[1:], __doc__)
    address = dask.config.get("scheduler-address", None)
    # One process and one thread per core: a task runs cobscope with one thread.
    cluster = address or LocalCluster(n_workers=os.cpu_count(), threads_per_worker=1, dashboard_address=None)
    with Client(cluster) as client:
        client.upload_file(fleet_job.__file__)
        tasks = fleet_job.prepare(job)
        # Equal tasks of two runs must both run: `pure` would return an earlier result.
        futures = client.map(fleet_job.add_all, tasks, job=job, pure=False)
        fleet_job.print_results([result for results in client.gather(futures) for result in results])


if __name__ == "__main__":
    main()
