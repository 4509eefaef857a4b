"""The fixed list of cases, and where their files are."""

from __future__ import annotations

from pathlib import Path

from .generate import generate, name_of
from .walk_case import POLICY

FIXED = [
    *(("rig", seed) for seed in range(1100, 1172)),
    *(("leg", seed) for seed in range(1100, 1124)),
    *(("walk", seed) for seed in range(1100, 1108)),
]
"""Machine and seed; to be run once, after the procedure is frozen."""

TENTH = [
    *(("rig", seed) for seed in range(900, 972)),
    *(("leg", seed) for seed in range(928, 952)),
    *(("walk", seed) for seed in range(900, 908)),
]
"""The fixed list of the procedure as it was frozen for the tenth time, all of it, run before another simulator's axis showed that commands act within
the millisecond they come in and what the physics step leaves, and an arm a load that is no point at its link's centre of mass, and the
procedure was changed."""

NINTH = [
    *(("rig", seed) for seed in range(800, 872)),
    *(("leg", seed) for seed in range(901, 910)),
    *(("walk", seed) for seed in (800, 801, 802, 804, 805)),
]
"""Those of the fixed list of the procedure as it was frozen for the ninth time that were run before they showed ripples too slow to be begun at their
frequency (leg 906), folds that let numbers go which they alone tell (rig 865) and an effect that had to make up for other joints' noise (leg 901), and
the procedure was changed. Its rigs and walks were the eighth's, as what had changed since was of robots with several joints whose base is held."""

EIGHTH = [("leg", seed) for seed in (*range(800, 818), 820, 824, 828)]
"""The legs of the fixed list of the procedure as it was frozen for the eighth time that were run before they showed effects that were never fitted
(legs 805, 813 and 817), and the procedure was changed for robots with several joints whose base is held."""

SEVENTH = [
    *(("rig", seed) for seed in range(700, 772)),
    *(("leg", seed) for seed in range(700, 713)),
    *(("walk", seed) for seed in range(700, 708)),
]
"""Those of the fixed list of the procedure as it was frozen for the seventh time that were run before measured logs (the XL330's) showed a
named effect that gave way to a table which predicted less, and legs a load that re-tuning made up for, and the procedure was changed."""

SIXTH = [*(("rig", seed) for seed in range(600, 672)), ("leg", 600), *(("walk", seed) for seed in range(600, 608))]
"""Those of the fixed list of the procedure as it was frozen for the sixth time that were run before a review found stretches that were guarded on
one side alone, and its intervals were seen to be too narrow, and the procedure was changed."""

FIFTH = [
    *(("rig", seed) for seed in range(500, 572)),
    *(("leg", seed) for seed in range(500, 521)),
    *(("walk", seed) for seed in range(500, 508)),
]
"""Those of the fixed list of the procedure as it was frozen for the fifth time that were run before intervals were seen to be too wide and
a soft spring not to be found (rig 505), and the procedure was changed."""

FOURTH = [*(("rig", seed) for seed in (*range(400, 463), 464, 466, 468, 470)), ("leg", 400)]
"""Those of the fixed list of the procedure as it was frozen for the fourth time that were run before measured logs (the XL330's) showed
friction under load that is not found from its plain form, and the procedure was changed; also for Stribeck's friction, in whose place the
list has tables over velocity (rigs 413, 438, 454 and 462)."""

THIRD = [*(("rig", seed) for seed in range(300, 372)), *(("leg", seed) for seed in range(300, 309)), ("walk", 300)]
"""Those of the fixed list of the procedure as it was frozen for the third time that were run before its rigs showed a cross-validation that
ran away (rig 314) and ripples that were named with a scale of the encoder (rigs 323 and 363), and the procedure was changed."""

SECOND = [
    *(("rig", seed) for seed in range(200, 272)),
    *(("leg", seed) for seed in range(200, 232)),
    *(("walk", seed) for seed in (200, 201, 202, 203, 204, 207)),
]
"""Those of the fixed list of the procedure as it was frozen for the second time that were run before it was known that re-tuning had ended in
lesser minima, and the procedure was changed."""

FIRST = [("rig", seed) for seed in range(72)]
"""The rigs of the fixed list of the procedure as it was frozen first. Its 32 legs and 8 walks were left when these showed intervals that
are too narrow (one healthy leg was run, and nothing said of it). What came out changed the procedure: it is no measure of it any more."""

REHEARSAL = [
    *(("rig", seed) for seed in (*range(1000, 1016), 1017, 1018, 1021, 1025, 1026, 1029, 1033, 1034, 1037)),
    *(("leg", seed) for seed in range(1000, 1012)),
    *(("walk", seed) for seed in range(1000, 1004)),
]
"""What the procedure was worked out on: no measure of it."""

LISTS = {
    **{"fixed": FIXED, "tenth": TENTH, "ninth": NINTH, "eighth": EIGHTH, "seventh": SEVENTH, "sixth": SIXTH, "fifth": FIFTH},
    **{"fourth": FOURTH, "third": THIRD, "second": SECOND, "first": FIRST, "rehearsal": REHEARSAL},
}


def ensure(machine: str, seed: int, out: Path, walker: Path = POLICY) -> Path:
    """The folder of a case, made if its truth, which is written last, is not there; `walker` is the policy of machines that walk."""
    name = name_of(machine, seed)
    if not (out / "truth" / f"{name}.json").exists():
        generate(machine, seed, out, walker=walker)
    return out / "cases" / name
