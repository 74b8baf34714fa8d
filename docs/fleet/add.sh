#!/usr/bin/env bash
# Adds the captures of a fleet to a lake on one machine: a process per core, each with the folder of one machine.
#
#   docs/fleet/add.sh CAPTURES LAKE [OPTION…]
#
# CAPTURES contains a folder per machine, with its name; an option --machine… replaces this rule. Options are passed to
# `cobscope lake add`. Runs can be repeated and interrupted; several runs on one lake wait for each other where they add the same
# capture.
set -euo pipefail
captures=$1 lake=$2
shift 2
mkdir -p "$lake"
if [ -n "$(find -L "$captures" -mindepth 1 -maxdepth 1 -type f -print -quit)" ]; then
  echo "add.sh: files directly in $captures are not read: each machine needs a folder" >&2
fi

# Exit status 3 states unreadable captures, whose reasons are in the table `captures`; any other one ends the script with 123.
export COBSCOPE LAKE=$lake
COBSCOPE=${COBSCOPE:-cobscope}
find -L "$captures" -mindepth 1 -maxdepth 1 -type d -print0 |
  xargs -0 -r -P "$(nproc)" -I{} bash -c '
    folder=$1
    shift
    machine=(--machine "${folder##*/}")
    for word; do [[ $word != --machine* ]] || machine=(); done
    status=0
    "$COBSCOPE" lake add "$LAKE" --threads 1 "${machine[@]}" "$@" "$folder" || status=$?
    ((status == 0 || status == 3))
  ' _ {} "$@"
