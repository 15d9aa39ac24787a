#!/usr/bin/env bash
# Runs the benchmarks and writes their output, with date and processor, to results/baselines/bench. Use an idle machine.
#   benches/record.sh [NAME...]     names: solver, cost, engine
set -euo pipefail
cd "$(dirname "$0")/.."
out=results/baselines/bench
mkdir -p "$out"
for name in "${@:-solver cost engine}"; do
  for bench in $name; do
    arguments=()
    [ "$bench" = cost ] && arguments=(studies/table1_radau.toml)
    {
      date -u +"%Y-%m-%d"
      grep -m1 "model name" /proc/cpuinfo | sed 's/.*: //'
      echo "cargo bench --bench $bench ${arguments[*]:+-- ${arguments[*]}}"
      cargo bench -q --bench "$bench" -- "${arguments[@]}" 2> /dev/null
    } > "$out/$bench.txt.new"
    mv "$out/$bench.txt.new" "$out/$bench.txt"
  done
done
