#!/bin/sh
# Trains the three seeds of configs/forward.toml, judges them in rapier and draws them; what is committed beside this script are
# the small files: every twentieth row of the metrics, configuration, evaluation, pictures.
# Usage: runs/forward/make.sh [FOLDER], after cargo build --release.
set -eu
cd "$(dirname "$0")/../.."
omniwalk="${OMNIWALK:-target/release/omniwalk}"
out="${1:-target/forward}"
here=runs/forward
for seed in 1 2 3; do
    run="$out/seed-$seed"
    [ -d "$run" ] || "$omniwalk" train configs/forward.toml --seed "$seed" --run "$run"
    "$omniwalk" eval "$run" | tee "$run/eval.txt"
    mkdir -p "$here/seed-$seed"
    cp "$run/config.toml" "$here/seed-$seed/"
    for file in eval.json eval.txt; do
        sed "/^rollout/d; s#$run#seed-$seed#" "$run/$file" > "$here/seed-$seed/$file"
    done
    awk 'NR == 1 || NR % 20 == 0' "$run/metrics.csv" > "$here/seed-$seed/metrics.csv"
done
"$omniwalk" report "$out/seed-1" "$out/seed-2" "$out/seed-3" --out "$here"
mv "$here/gait.png" docs/pictures/
rm -f "$here/report.html" "$here/filmstrip.png"
