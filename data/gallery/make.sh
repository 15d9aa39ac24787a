#!/usr/bin/env bash
# Makes the README's gallery from the shipped studies: runs the quick ones, and takes the others from their baselines.
#   data/gallery/make.sh [SINEW]
set -euo pipefail
cd "$(dirname "$0")/../.."
sinew=${1:-target/release/sinew}
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT

# figures FOLDER JOB NAME...: draws the figures of a results folder, and keeps the named ones.
figures() {
  local from=$1 job=$2
  shift 2
  rm -rf "$dir/figures"
  "$sinew" report "$from" --out "$dir/report.html" --svg --job "$job" > /dev/null
  for name in "$@"; do
    cp "$dir/figures/$name.svg" "data/gallery/$(basename "$from")-$name.svg"
  done
}

rm -f data/gallery/*.svg
for study in table1 arm26 mu_sweep; do
  "$sinew" run "studies/$study.toml" --out "$dir/$study" > /dev/null 2>&1
done
figures "$dir/table1" 5 job-5-convergence job-5-singular_values job-5-fibre_velocity job-5-stick_figure_side
figures "$dir/arm26" 0 job-0-activation job-0-active_bounds
figures "$dir/mu_sweep" 600 mean_force_n-over-mu-All_muscles
figures results/baselines/abduction 0 ratio-over-motion.abduction_offset_deg-teres_major_to_latissimus_dorsi_mean_force
