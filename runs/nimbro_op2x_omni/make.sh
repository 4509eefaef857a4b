#!/bin/sh
# Trains the default, plays DeepWalk's evaluation in rapier and keeps the small files beside this script.
# Usage: runs/nimbro_op2x_omni/make.sh [FOLDER], after cargo build --release.
set -eu
cd "$(dirname "$0")/../.."
omniwalk="${OMNIWALK:-target/release/omniwalk}"
run="${1:-target/omni}"
here=runs/nimbro_op2x_omni
[ -d "$run" ] || "$omniwalk" train --run "$run"
"$omniwalk" eval "$run" --suite falls,changes,push --seed 2000 | tee "$run/eval.txt"
cp "$run/config.toml" "$run/eval_push.png" "$here/"
for file in eval.json eval.txt; do
    sed "/^rollout/d; /^picture/d; s#$run#nimbro_op2x_omni#" "$run/$file" > "$here/$file"
done
awk 'NR == 1 || NR % 40 == 0' "$run/metrics.csv" > "$here/metrics.csv"
