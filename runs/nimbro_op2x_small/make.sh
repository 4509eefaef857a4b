#!/bin/sh
# Trains the defaults, scaled, on the robot of 70 % the size and 8 kg, and plays the suite `falls` of DeepWalk's evaluation in rapier; what is
# committed beside this script are the small files. What is finished is not done again: stop it and go on at will.
# Usage: runs/nimbro_op2x_small/make.sh [FOLDER], after cargo build --release.
set -eu
cd "$(dirname "$0")/../.."
omniwalk="${OMNIWALK:-target/release/omniwalk}"
run="${1:-target/small/seed-1}"
here=runs/nimbro_op2x_small
if [ ! -d "$run" ]; then
    "$omniwalk" train robots/nimbro_op2x_small/train.toml --seed 1 --run "$run"
elif [ ! -f "$run/eval.txt" ]; then
    "$omniwalk" train --resume --run "$run"
fi
if [ ! -f "$run/eval.txt" ]; then
    "$omniwalk" eval "$run" --suite falls --seed 9000 > "$run/eval.draft"
    mv "$run/eval.draft" "$run/eval.txt"
fi
cp "$run/config.toml" "$here/"
for file in eval.json eval.txt; do
    sed "/^rollout/d; /^picture/d; s#$run#nimbro_op2x_small#" "$run/$file" > "$here/$file"
done
awk 'NR == 1 || NR % 40 == 0' "$run/metrics.csv" > "$here/metrics.csv"
