#!/usr/bin/env bash
# Adds the captures of a fleet to a lake on one machine: a process per core, each with the folder of one machine.
#
#   docs/fleet/add.sh CAPTURES LAKE [OPTION…]
#
# CAPTURES contains a folder per machine. Options are passed to `cobscope lake add`. Runs can be repeated and interrupted;
# several runs on one lake wait for each other where they add the same capture.
set -euo pipefail
captures=$1 lake=$2
shift 2
mkdir -p "$lake"

# Exit status 3 states unreadable captures, whose reasons are in the table `captures`; xargs would stop at 255 only.
status=0
find "$captures" -mindepth 1 -maxdepth 1 -type d -print0 |
  xargs -0 -r -P "$(nproc)" -I{} \
    "${COBSCOPE:-cobscope}" lake add "$lake" --threads 1 --machine-from '([^/]+)/[^/]+$' "$@" {} || status=$?
# 123: at least one process had another status than 0.
if ((status != 0 && status != 123)); then exit "$status"; fi
