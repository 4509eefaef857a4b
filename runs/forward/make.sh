#!/bin/sh
# Trains the three seeds of configs/forward.toml, judges them in rapier and draws them. What is committed here are the small
# files: metrics, configuration, evaluation, pictures.
set -eu
cd "$(dirname "$0")/../.."
omniwalk="${OMNIWALK:-target/release/omniwalk}"
out="${1:-/tmp/omniwalk-forward}"
for seed in 1 2 3; do
    "$omniwalk" train configs/forward.toml --seed "$seed" --run "$out/seed-$seed"
    "$omniwalk" eval "$out/seed-$seed" | tee "$out/seed-$seed/eval.txt"
done
"$omniwalk" report "$out/seed-1" "$out/seed-2" "$out/seed-3" --out "$out"
