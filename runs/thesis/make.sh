#!/bin/sh
# Trains configs/thesis.toml for 3 M steps, with the thesis's Butterworth filter on the increment and (no-filter) without, and once over
# its 71 M (full, two to four hours by the machine), and judges all in rapier; what is committed beside this script are the small files.
# Usage: runs/thesis/make.sh [FOLDER], after cargo build --release. A run that was stopped goes on.
set -eu
cd "$(dirname "$0")/../.."
omniwalk="${OMNIWALK:-target/release/omniwalk}"
out="${1:-target/thesis}"

train() { # RUN OPTIONS...
    run="$1"
    shift
    if [ -d "$run" ]; then
        "$omniwalk" train --resume --run "$run"
    else
        "$omniwalk" train configs/thesis.toml --run "$run" "$@"
    fi
}

judge() { # RUN HERE THINNED OPTIONS...
    run="$1" here="$2" thinned="$3"
    shift 3
    "$omniwalk" eval "$run" "$@" > "$run/eval.txt"
    mkdir -p "$here"
    cp "$run/config.toml" "$run/sessions.toml" "$here/"
    for file in eval.json eval.txt; do
        sed "/^rollout/d; s#$run#thesis#" "$run/$file" > "$here/$file"
    done
    awk -v every="$thinned" 'NR == 1 || NR % every == 0' "$run/metrics.csv" > "$here/metrics.csv"
}

train "$out" --steps 3000000
judge "$out" runs/thesis 10
train "$out-no-filter" --steps 3000000 --set action.filter.enabled=false
judge "$out-no-filter" runs/thesis/no-filter 10
train "$out-full" --engine lanes --seed 1
judge "$out-full" runs/thesis/full 100 --suite falls,changes --seed 9000
