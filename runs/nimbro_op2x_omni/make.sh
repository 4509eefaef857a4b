#!/bin/sh
# Trains five seeds of the default, plays DeepWalk's evaluation of each in rapier and keeps the small files beside this script.
# The 2980 sequences of the suite `tracking`, which take longer than all else, are played with seed 1, the reference run, alone.
# What is finished is not done again: stop it and go on at will.
# Usage: runs/nimbro_op2x_omni/make.sh [FOLDER] [SEED...], after cargo build --release.
set -eu
cd "$(dirname "$0")/../.."
omniwalk="${OMNIWALK:-target/release/omniwalk}"
out="${1:-target/omni}"
[ $# -gt 0 ] && shift
here=runs/nimbro_op2x_omni

# Pictures of the policy at its commands: a walk forward, and the five walks of the thesis's figure 7.7 with the gait of the fastest.
pictures() {
    rollouts "[[0.4,0,0]]"
    mv "$here/policy.eval/filmstrip.png" docs/pictures/filmstrip.png
    rollouts "[[0.6,0,0],[-0.5,0,0],[0,0.6,0],[0,0,0.5],[0.6,0,0.2]]"
    mv "$here/policy.eval/filmstrip.png" docs/pictures/omni-filmstrip.png
    mv "$here/policy.eval/gait.png" docs/pictures/omni-gait.png
}

rollouts() { # COMMANDS
    rm -rf "$here/policy.eval"
    "$omniwalk" eval "$here/policy.omni" --episodes 4 --seconds 12 --set "eval.commands=$1" > /dev/null
    "$omniwalk" report "$here/policy.omni" > /dev/null
}

for seed in ${*:-1 2 3 4 5}; do
    run="$out/seed-$seed"
    if [ ! -d "$run" ]; then
        "$omniwalk" train --seed "$seed" --run "$run"
    elif [ ! -f "$run/eval.txt" ]; then
        "$omniwalk" train --resume --run "$run"
    fi
    if [ ! -f "$run/eval.txt" ]; then
        suites=falls,changes,push
        [ "$seed" = 1 ] && suites=all
        "$omniwalk" eval "$run" --suite "$suites" --seed 9000 > "$run/eval.draft"
        mv "$run/eval.draft" "$run/eval.txt"
    fi
    mkdir -p "$here/seed-$seed"
    cp "$run/config.toml" "$here/seed-$seed/"
    for file in eval.json eval.txt; do
        sed "/^rollout/d; /^picture/d; s#$run#seed-$seed#" "$run/$file" > "$here/seed-$seed/$file"
    done
    if [ "$seed" = 1 ]; then
        cp "$run"/eval_*.png "$run/rollouts/tracking.mcap" "$here/seed-$seed/"
        "$omniwalk" export "$run" --out "$here/policy.omni"
    fi
    [ "$seed" = 1 ] && pictures
    awk 'NR == 1 || NR % 40 == 0' "$run/metrics.csv" > "$here/seed-$seed/metrics.csv"
done
