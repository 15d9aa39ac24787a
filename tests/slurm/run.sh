#!/usr/bin/env bash
# Runs a study on a real Slurm cluster of two nodes and loses one of them in the middle: the merged tables must equal those of a local run.
#   tests/slurm/run.sh [SINEW]
# Skipped with a message if Slurm cannot be installed (no root, no Debian packages).
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
sinew=$(realpath "${1:-target/release/sinew}")

if [ "$(id -u)" != 0 ] || ! "$here/cluster.sh" install > /dev/null 2>&1; then
  echo "SKIPPED: the Slurm test: it needs root and Debian's slurm-wlm and munge"
  exit 0
fi
dir=$(mktemp -d /tmp/slurm-test.XXXXXX)
clean() {
  "$here/cluster.sh" down "$dir"
  rm -rf "$dir" || echo "left behind: $dir"
}
trap clean EXIT
if ! "$here/cluster.sh" up "$dir" 2> "$dir/up.log"; then
  cat "$dir/up.log"
  echo "SKIPPED: the Slurm test: no cluster comes up on this machine"
  exit 0
fi
export SLURM_CONF="$dir/slurm.conf"
fail() {
  echo "FAILED: $*"
  timeout 10 squeue || true
  tail -n 5 "$dir"/cluster/slurm/log/* "$dir/log/slurmctld.log" || true
  exit 1
}

cat > "$dir/study.toml" << STUDY
name = "cluster"
model = "$here/../../data/models/arm.toml"
motion = "$here/../../data/motions/arm_curl.csv"
[base]
h = 0.02
stages = 1
[sweep.grid]
bounds = ["activation", "both"]
mu = { from = 0.05, to = 0.5, count = 36 }
STUDY
"$sinew" run "$dir/study.toml" --out "$dir/local" > /dev/null 2>&1

finished() { cat "$dir"/cluster/finished*.jsonl 2> /dev/null | wc -l; }
waiting() { timeout 10 squeue -h -o %i | wc -l; }
# Waits until nothing is queued. Elements that ran on a lost node would be held for two minutes, so they are released.
until_done() {
  for _ in $(seq 1200); do
    for job in $(timeout 10 squeue -h -t PD -o '%A %r' | awk '$2 == "BeginTime" { print $1 }'); do
      timeout 10 scontrol update jobid="$job" StartTime=now || true
    done
    [ "$(waiting)" = 0 ] && return
    sleep 0.5
  done
  fail "the queue does not empty"
}
same() { "$sinew" compare "$dir/cluster" "$dir/local" --tolerance '*=exact' > "$dir/compare.txt" || { head "$dir/compare.txt"; fail "other tables than the local run's"; }; }

echo "submit 20 shards; an array has 9"
"$sinew" slurm "$dir/study.toml" --out "$dir/cluster" --shards 20 --submit | tee "$dir/submit.txt"
grep -q '^submitted 9 shards (0-8)' "$dir/submit.txt" || fail "the array is not as large as it may be"

for _ in $(seq 1200); do
  [ "$(finished)" -ge 8 ] && break
  sleep 0.05
done
"$here/cluster.sh" kill "$dir" n2
at=$(finished)
echo "node n2 lost with $at of 72 jobs finished"
[ "$at" -lt 72 ] || fail "the node was lost too late to matter"
until_done
timeout 10 scontrol show job > "$dir/jobs.txt"
grep -q 'Restarts=1' "$dir/jobs.txt" || fail "no element was started again"
grep -q '72 of 72 jobs finished' "$dir/cluster/slurm/log/merge.log" || fail "the merge did not see all jobs"
same
echo "node lost, elements started again, merged: the same tables"

echo "two shards' results go; only they are submitted again"
rm "$dir"/cluster/finished.3-of-9*.jsonl "$dir"/cluster/finished.7-of-9*.jsonl "$dir"/cluster/*.parquet
"$sinew" merge "$dir/cluster" > "$dir/merge.txt" && fail "a merge of less than all said nothing"
grep -q '16 jobs are missing' "$dir/merge.txt" || fail "the merge does not say what is missing"
"$sinew" slurm "$dir/study.toml" --out "$dir/cluster" --submit | tee "$dir/submit.txt"
grep -q '^submitted 2 shards (3,7)' "$dir/submit.txt" || fail "other shards than those with something missing"
until_done
same
"$sinew" slurm "$dir/study.toml" --out "$dir/cluster" --submit > "$dir/submit.txt"
grep -q 'no jobs are missing' "$dir/submit.txt" || fail "submitted for nothing"
echo "the Slurm test passed"
