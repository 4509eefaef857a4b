#!/bin/sh
# Trains configs/thesis.toml for 3 M steps, with the thesis's Butterworth filter on the increment and (no-filter) without, and judges both in
# rapier; what is committed beside this script are the small files.
# Usage: runs/thesis/make.sh [FOLDER], after cargo build --release.
set -eu
cd "$(dirname "$0")/../.."
omniwalk="${OMNIWALK:-target/release/omniwalk}"
out="${1:-target/thesis}"

judge() { # RUN HERE
    "$omniwalk" eval "$1" > "$1/eval.txt"
    mkdir -p "$2"
    cp "$1/config.toml" "$2/"
    for file in eval.json eval.txt; do
        sed "/^rollout/d; s#$1#thesis#" "$1/$file" > "$2/$file"
    done
    awk 'NR == 1 || NR % 10 == 0' "$1/metrics.csv" > "$2/metrics.csv"
}

[ -d "$out" ] || "$omniwalk" train configs/thesis.toml --steps 3000000 --run "$out"
judge "$out" runs/thesis
[ -d "$out-no-filter" ] ||
    "$omniwalk" train configs/thesis.toml --steps 3000000 --set action.filter.enabled=false --run "$out-no-filter"
judge "$out-no-filter" runs/thesis/no-filter
