#!/bin/sh
# Trains configs/thesis.toml for 3 M steps and judges it in rapier; what is committed beside this script are the small files.
# Usage: runs/thesis/make.sh [FOLDER], after cargo build --release.
set -eu
cd "$(dirname "$0")/../.."
omniwalk="${OMNIWALK:-target/release/omniwalk}"
run="${1:-target/thesis}"
here=runs/thesis
[ -d "$run" ] || "$omniwalk" train configs/thesis.toml --steps 3000000 --run "$run"
"$omniwalk" eval "$run" > "$run/eval.txt"
cp "$run/config.toml" "$here/"
for file in eval.json eval.txt; do
    sed "/^rollout/d; s#$run#thesis#" "$run/$file" > "$here/$file"
done
awk 'NR == 1 || NR % 10 == 0' "$run/metrics.csv" > "$here/metrics.csv"
