"""Runs the jobs of docs/fleet on a generated fleet and checks their lakes.

    fleet_jobs.py PROGRAM FOLDER MACHINES DAYS

A run with Spark, a second one that adds nothing, one whose driver is killed and started again, one with Dask, and one that reads
and writes an object store (moto, which has the interface of S3) must give the same lake. Its findings must be those of `check`, its
reasons of failures those of the three broken files. A run with a wrong option is repeated, `--replace` reads again, and add.sh ends
with an error only if an option is wrong. Prints captures per minute.
"""

import hashlib
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time

import pyarrow.dataset as ds
from pyarrow import fs

REPOSITORY = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BROKEN = 3


def command(program, fleet, lake, job="fleet_job.py"):
    job = os.path.join(REPOSITORY, "docs/fleet", job)
    options = ["--bus", f"{fleet}/press.bus.toml", "--machine-from", "(press-[0-9]+)/", "--cobscope", program]
    return [sys.executable, job, fleet, lake, *options]


def start(words, **options):
    environment = {**os.environ, "PYSPARK_PYTHON": sys.executable, "SPARK_LOCAL_IP": "127.0.0.1"}
    environment["PYSPARK_SUBMIT_ARGS"] = "--master local[2] --conf spark.ui.enabled=false pyspark-shell"
    return subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options)


def run(words):
    begin = time.monotonic()
    process = start(words)
    output, _ = process.communicate()
    if process.returncode != 0:
        sys.exit(f"the job ended with {process.returncode}:\n{output[-4000:]}")
    return output, time.monotonic() - begin


def files(lake):
    """Content of all files but those of the job itself."""
    found = {}
    for folder, _, names in os.walk(lake):
        for name in names:
            path = os.path.join(folder, name)
            place = os.path.relpath(path, lake)
            # Hadoop's checksums beside files, and what is in progress.
            if name.endswith(".crc") or place.startswith("_staging"):
                continue
            with open(path, "rb") as file:
                found[place] = hashlib.sha256(file.read()).hexdigest()
    return found


def rows(lake, table):
    return ds.dataset(f"{lake}/{table}", format="parquet", partitioning="hive").to_table().to_pylist()


def without_capture(line):
    """A finding without what depends on the folder in which its capture was read."""
    finding = json.loads(line)
    finding.pop("capture")
    return json.dumps(finding, sort_keys=True)


def findings_of_check(program, fleet):
    words = [program, "check", "-f", "jsonl", "--bus", f"{fleet}/press.bus.toml", fleet]
    output = subprocess.run(words, capture_output=True, text=True, check=False).stdout
    return [line for line in output.splitlines() if json.loads(line)["kind"] == "finding"]


def main():
    if len(sys.argv) != 5:
        sys.exit(__doc__)
    program, folder, machines, days = sys.argv[1:]
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(folder)
    fleet, lake, killed, dask = (os.path.join(folder, name) for name in ("fleet", "lake", "killed", "dask"))
    maker = os.path.join(REPOSITORY, "fixtures/fleet/make_fleet.py")
    subprocess.run([sys.executable, maker, fleet, "--machines", machines, "--days", days, "--extras"], check=True)

    output, elapsed = run(command(program, fleet, lake))
    captures = rows(lake, "captures")
    print(output.strip().splitlines()[-1])
    print(f"{len(captures)} captures in {elapsed:.0f} s: {60 * len(captures) / elapsed:.0f} per minute")
    reasons = rows(lake, "failures")
    assert len(reasons) == BROKEN and all(row["reason"] for row in reasons), reasons
    hashes = [row["capture_hash"] for row in captures]
    assert len(hashes) == len(set(hashes)), "a capture is in the lake twice"

    found = sorted(without_capture(row["json"]) for row in rows(lake, "findings"))
    expected = sorted(map(without_capture, findings_of_check(program, fleet)))
    # `check` judges copies too.
    missing = set(found).symmetric_difference(expected)
    assert not missing, f"{len(found)} findings in the lake, {len(expected)} of check: {sorted(missing)[:3]}"

    whole = files(lake)
    output, _ = run(command(program, fleet, lake))
    assert re.search(r"^0 new captures", output, re.M), output[-2000:]
    assert files(lake) == whole, "a second run changed the lake"

    # Killed as soon as the first captures are in the lake.
    process = start(command(program, fleet, killed), start_new_session=True)
    while process.poll() is None and len(os.listdir(f"{killed}/_index") if os.path.isdir(f"{killed}/_index") else []) < 3:
        time.sleep(0.05)
    assert process.poll() is None, "the job ended before it was killed"
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    before = len(files(killed))
    run(command(program, fleet, killed))
    assert_equal(whole, files(killed), "after a killed run")
    print(f"{len(whole)} files; equal after a run that was killed with {before} of them")

    _, elapsed = run(command(program, fleet, dask, "fleet_dask.py"))
    assert_equal(whole, files(dask), "with Dask")
    print(f"equal with Dask: {60 * len(captures) / elapsed:.0f} captures per minute")

    plain = os.path.join(folder, "plain")
    subprocess.run([sys.executable, maker, plain, "--machines", "1", "--days", "5"], check=True)
    repeated(program, f"{plain}/press-01", os.path.join(folder, "repeated"))
    on_one_machine(program, fleet, os.path.join(folder, "one"))

    elapsed = on_object_store(program, fleet, folder, whole)
    print(f"equal on an object store: {60 * len(captures) / elapsed:.0f} captures per minute")


def repeated(program, captures, lake):
    """A capture that failed for another reason than its content is tried again; `--replace` reads captures of the lake again."""
    sys.path.insert(0, os.path.join(REPOSITORY, "docs/fleet"))
    import fleet_job

    def add(*further):
        job = fleet_job.job_of([captures, lake, "--cobscope", program, "--", *further], "")
        results = [result for task in fleet_job.prepare(job) for result in fleet_job.add_all(task, job)]
        return [sum(result[place] for result in results) for place in (0, 1)], [result[2] for result in results]

    found, reasons = add("--machine", "one", "--frame")
    count = len(reasons)
    assert found == [0, 0] and count > 3 and all("exit status 2" in reason[0] for reason in reasons), reasons
    assert len(rows(lake, "failures")) == count
    assert add("--machine", "one") == ([count, 0], [[]] * count)
    assert not [name for name in files(lake) if name.startswith("failures/")]
    assert add("--machine", "one") == ([0, 0], [])
    assert add("--machine", "two", "--replace") == ([count, 0], [[]] * count)
    captures = rows(lake, "captures")
    assert len(captures) == count and {row["machine"] for row in captures} == {"two"}, captures
    print(f"{count} captures tried again after a wrong option, and replaced")


def on_one_machine(program, fleet, lake):
    """The script names machines by their folders, and hides no wrong option."""
    def add(*options):
        words = [os.path.join(REPOSITORY, "docs/fleet/add.sh"), fleet, lake, *options]
        return subprocess.run(words, env={**os.environ, "COBSCOPE": program}, capture_output=True, text=True, check=False)

    run = add("--frame")
    assert run.returncode == 123 and "--frame" in run.stderr, run
    run = add("--bus", f"{fleet}/press.bus.toml")
    assert run.returncode == 0 and "not read: each machine needs a folder" in run.stderr, run.stderr[-2000:]
    machines = {row["machine"] for row in rows(lake, "captures")}
    folders = {name for name in os.listdir(fleet) if os.path.isdir(os.path.join(fleet, name))}
    assert machines == folders, (machines, folders)
    print(f"add.sh: {len(machines)} machines")


def on_object_store(program, fleet, folder, expected):
    """Runs the job with captures and lake in buckets, and returns the seconds it took."""
    os.environ.update(AWS_ACCESS_KEY_ID="test", AWS_SECRET_ACCESS_KEY="test", AWS_EC2_METADATA_DISABLED="true")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        place = f"127.0.0.1:{free.getsockname()[1]}"
    words = [os.path.join(os.path.dirname(sys.executable), "moto_server"), "-H", "127.0.0.1", "-p", place.split(":")[1]]
    server = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        store = fs.S3FileSystem(endpoint_override=place, scheme="http", region="us-east-1", allow_bucket_creation=True)
        create_buckets(store, server)
        fs.copy_files(fleet, "captures", destination_filesystem=store)
        own = [f"s3://{bucket}?endpoint_override={place}&scheme=http&region=us-east-1" for bucket in ("captures", "lake")]
        words = command(program, fleet, "")
        output, elapsed = run([*words[:2], *own, *words[4:]])
        copy = os.path.join(folder, "from-store")
        fs.copy_files("lake", copy, source_filesystem=store)
    finally:
        server.terminate()
        server.wait()
    # The names of `_files` depend on the times of change.
    content = [{name: content for name, content in lake.items() if not name.startswith("_files")} for lake in (expected, files(copy))]
    assert_equal(*content, f"on an object store: {output[-1000:]}")
    return elapsed


def create_buckets(store, server):
    """Creates the buckets as soon as the server answers."""
    for _ in range(600):
        assert server.poll() is None, "moto_server ended"
        try:
            for bucket in ("captures", "lake"):
                store.create_dir(bucket)
            return
        except OSError:
            time.sleep(0.1)
    sys.exit("moto_server does not answer")


def assert_equal(one, other, when):
    different = {name for name in one.keys() | other.keys() if one.get(name) != other.get(name)}
    assert not different, f"{when}: {sorted(different)[:5]}"


if __name__ == "__main__":
    main()
