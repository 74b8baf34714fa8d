"""Adds the captures of a fleet to a lake, with Spark: one task per capture, on local copies.

    spark-submit fleet_job.py CAPTURES LAKE [--bus FILE] [--machine-from REGEX] [--cobscope PROGRAM] [-- OPTION…]

CAPTURES and LAKE are folders or addresses that pyarrow.fs reads (s3://, gs://, abfss://, hdfs://, file://). Only new or changed
files are read, with `-- --replace` all of them. Options after -- are passed to `cobscope lake add`. docs/fleet.md has figures.
"""

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor

import pyarrow as pa
import pyarrow.fs as pafs
import pyarrow.parquet as pq

BLOCK = 8 << 20
# A counter of at least three digits at the end of the name: run_0001.log, run-002.mf4.gz.
COUNTER = re.compile(r"[-_.]?\d{3,}(?=(\.[A-Za-z][A-Za-z0-9]*)+$)")
LOCAL = ("local", "subtree", "hdfs")
TEMPORARY = "_staging/job"
EMPTY = "machine=unknown/day=unknown/empty.parquet"
PARTS_OF_LAKE = ("frames/", "signals/", "events/", "objects/", "findings/", "captures/", "wide/")


def open_folder(uri):
    """File system and path of a folder."""
    if "://" not in uri:
        return pafs.LocalFileSystem(), uri
    return pafs.FileSystem.from_uri(uri)


def list_captures(uri):
    """All files as (path below the folder, size, time of change in ns)."""
    system, root = open_folder(uri)
    found = system.get_file_info(pafs.FileSelector(root, recursive=True))
    files = [(info.path[len(root):].lstrip("/"), info.size, info.mtime_ns or 0) for info in found if info.is_file]
    return sorted(file for file in files if not os.path.basename(file[0]).startswith((".", "_")))


def series_of(files):
    """Files that may be parts of one capture, because their names differ only in a counter; cobscope decides."""
    groups = {}
    for file in files:
        groups.setdefault(COUNTER.sub("", file[0]), []).append(file)
    return list(groups.values())


def key_of(group):
    """Name of a group in this state; a file that changed has another one."""
    return hashlib.sha256(json.dumps(group).encode()).hexdigest()[:32]


def head_of(uri, path):
    system, root = open_folder(uri)
    with system.open_input_file(f"{root}/{path}") as file:
        return file.read(4096)


def tasks_of(uri, groups):
    """One task per capture. Captures that may be copies are one task, in order: the first one is added."""
    by_size = {}
    for group in groups:
        by_size.setdefault(sum(size for _, size, _ in group), []).append(group)
    alike = [group for same in by_size.values() if len(same) > 1 for group in same]
    with ThreadPoolExecutor(16) as pool:
        heads = dict(zip([key_of(group) for group in alike], pool.map(lambda group: head_of(uri, group[0][0]), alike)))
    tasks = {}
    for group in groups:
        size = sum(size for _, size, _ in group)
        tasks.setdefault((size, heads.get(key_of(group))), []).append(group)
    return list(tasks.values())


def names_in(system, folder):
    found = system.get_file_info(pafs.FileSelector(folder, recursive=False, allow_not_found=True))
    return {os.path.splitext(info.base_name)[0] for info in found}


def exists(system, path):
    return system.get_file_info(path).type != pafs.FileType.NotFound


def put(system, root, name, source):
    """Uploads a whole file: object stores show it once it is whole, other systems once it is renamed."""
    place = f"{root}/{name}"
    is_local = system.type_name in LOCAL
    target = f"{root}/{TEMPORARY}/{hashlib.sha256(name.encode()).hexdigest()}-{os.getpid()}" if is_local else place
    if is_local:
        system.create_dir(os.path.dirname(place), recursive=True)
        system.create_dir(os.path.dirname(target), recursive=True)
    with system.open_output_stream(target) as output:
        while block := source.read(BLOCK):
            output.write(block)
    if is_local:
        # HDFS does not rename to the name of a file.
        if system.type_name == "hdfs" and exists(system, place):
            system.delete_file(place)
        system.move(target, place)


def put_bytes(system, root, name, content):
    put(system, root, name, pa.BufferReader(content))


def fetch(system, root, group, folder):
    for path, _, _ in group:
        place = os.path.join(folder, path)
        os.makedirs(os.path.dirname(place), exist_ok=True)
        with system.open_input_stream(f"{root}/{path}") as source, open(place, "wb") as copy:
            while block := source.read(BLOCK):
                copy.write(block)


def put_file(system, root, name, local):
    with open(os.path.join(local, name), "rb") as source:
        put(system, root, name, source)


def publish_tables(system, root, local):
    """Uploads the files without rows, which every lake has: one per table, that of `captures` last."""
    tables = sorted((name for name in os.listdir(local) if os.path.isfile(os.path.join(local, name, EMPTY))), key="captures".__eq__)
    if tables and not exists(system, f"{root}/{tables[-1]}/{EMPTY}"):
        for table in tables:
            put_file(system, root, f"{table}/{EMPTY}", local)


def publish(system, root, local, replaces):
    """Uploads the captures of a local lake; those that the lake has are left out, or replaced. Returns the reasons of failures."""
    publish_tables(system, root, local)
    added, present, reasons = 0, 0, []
    index = os.path.join(local, "_index")
    entries = [os.path.join(folder, name) for folder, _, names in os.walk(index) for name in names if name.endswith(".json")]
    for path in sorted(entries):
        place = os.path.relpath(path, local)
        with open(path, encoding="utf-8") as file:
            entry = json.load(file)
        captures = os.path.join(local, entry["files"][-1])
        failure = pq.ParquetFile(captures).read(["failure"])["failure"][0].as_py()
        if failure is not None:
            reasons.append(failure)
        former = []
        if exists(system, f"{root}/{place}"):
            if not replaces:
                present += 1
                continue
            with system.open_input_file(f"{root}/{place}") as file:
                former = json.loads(file.read())["files"]
        # The row of `captures` is the last of the files.
        for name in [*entry["files"], place]:
            put_file(system, root, name, local)
        for name in set(former).difference(entry["files"]):
            if name.startswith(PARTS_OF_LAKE) and ".." not in name and exists(system, f"{root}/{name}"):
                system.delete_file(f"{root}/{name}")
        added += 1
    return added, present, reasons


def add(group, job):
    """Adds the captures of one group; returns numbers and the reason of a failure."""
    source, source_root = open_folder(job["captures"])
    lake, lake_root = open_folder(job["lake"])
    reasons, added, present, is_read = [], 0, 0, False
    size = sum(size for _, size, _ in group)
    with tempfile.TemporaryDirectory(prefix="cobscope-") as folder:
        local = os.path.join(folder, "lake")
        inside = os.path.join(folder, "in")
        os.makedirs(inside)
        if size > job["max_bytes"]:
            reasons.append(f"{size} bytes; limit {job['max_bytes']}")
        elif any(part in ("", ".", "..") for path, _, _ in group for part in path.split("/")):
            reasons.append("name of the object leaves its folder")
        else:
            fetch(source, source_root, group, inside)
            # In a folder, cobscope leaves out files that are not captures.
            folders = sorted({path.split("/")[0] if "/" in path else "." for path, _, _ in group})
            command = [job["cobscope"], "lake", "add", local, "--threads", "1", *options(job, folder), "--", *folders]
            run = subprocess.run(command, cwd=inside, capture_output=True, text=True, errors="replace", check=False)
            if os.path.isdir(local) and run.returncode in (0, 3):
                added, present, reasons = publish(lake, lake_root, local, "--replace" in job["further"])
            is_read = run.returncode == 0 or (run.returncode == 3 and (bool(reasons) or "no captures" in run.stderr))
            if not is_read:
                reasons.append(f"exit status {run.returncode}: {run.stderr.strip()[-2000:]}")
    key, failed = key_of(group), f"failures/{hashlib.sha256(group[0][0].encode()).hexdigest()[:32]}.parquet"
    if reasons:
        table = pa.table({"capture": [group[0][0]], "size": [size], "reason": ["; ".join(reasons)]})
        buffer = pa.BufferOutputStream()
        pq.write_table(table, buffer, compression="zstd")
        put_bytes(lake, lake_root, failed, buffer.getvalue())
    elif exists(lake, f"{lake_root}/{failed}"):
        lake.delete_file(f"{lake_root}/{failed}")
    # What failed for another reason than its content is tried again by the next run.
    if is_read:
        put_bytes(lake, lake_root, f"_files/{key}.json", json.dumps(group).encode())
    return added, present, reasons, size


def options(job, folder):
    words = []
    if job["bus"]:
        words += ["--bus", os.path.join(folder, "bus.toml")]
        with open(words[-1], "wb") as file:
            file.write(job["bus"])
    return words + (["--machine-from", job["machine_from"]] if job["machine_from"] else []) + job["further"]


def add_all(task, job):
    """Adds the captures of a task in their order."""
    return [add([tuple(file) for file in group], job) for group in task]


def job_of(words, documentation):
    """The job that the arguments describe."""
    further = words[words.index("--") + 1:] if "--" in words else []
    parser = argparse.ArgumentParser(description=documentation, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures")
    parser.add_argument("lake")
    parser.add_argument("--bus")
    parser.add_argument("--machine-from")
    parser.add_argument("--cobscope", default="cobscope")
    parser.add_argument("--max-bytes", type=int, default=20 << 30, help="largest capture (default: %(default)s)")
    job = vars(parser.parse_args(words[:len(words) - len(further) - ("--" in words)]))
    for folder in ("captures", "lake"):
        # Workers start in other folders.
        job[folder] = job[folder] if "://" in job[folder] else os.path.abspath(job[folder])
    if job["bus"]:
        # Workers have no access to files of the driver.
        with open(job["bus"], "rb") as file:
            job["bus"] = file.read()
    return {**job, "further": further}


def prepare(job):
    """The tasks of captures that the lake does not have."""
    lake, root = open_folder(job["lake"])
    if lake.type_name in LOCAL:
        lake.create_dir(f"{root}/_index", recursive=True)
        lake.delete_dir_contents(f"{root}/{TEMPORARY}", missing_dir_ok=True)
    done = set() if "--replace" in job["further"] else names_in(lake, f"{root}/_files")
    groups = [group for group in series_of(list_captures(job["captures"])) if key_of(group) not in done]
    tasks = tasks_of(job["captures"], groups)
    print(f"{len(groups)} new captures or series in {len(tasks)} tasks; {len(done)} known")
    return tasks


def print_results(results):
    added, present = sum(result[0] for result in results), sum(result[1] for result in results)
    failed = [reason for result in results for reason in result[2]]
    print(f"{added} captures added, {present} already in the lake, {len(failed)} unreadable or incomplete, "
          f"{sum(result[3] for result in results)} bytes")


def main():
    job = job_of(sys.argv[1:], __doc__)

    from pyspark.sql import SparkSession

    spark = SparkSession.builder.appName("cobscope lake").getOrCreate()
    tasks = prepare(job)
    work = spark.sparkContext.parallelize(tasks, max(1, len(tasks)))
    print_results(work.flatMap(lambda task: add_all(task, job)).collect())
    spark.stop()


if __name__ == "__main__":
    main()
