"""The runner skips what is done and never opens the truth; the summary counts what it should."""

import json
import math
import sys

import pytest

from sealed import cases, runner, summary


def accepted(effect, target="hinge", **values):
    parameters = {key: {"value": value, "unit": "", "ci95": interval} for key, (value, interval) in values.items()}
    return {"effect": effect, "target": target, "parameters": parameters}


def errors(nominal, refit, final):
    return {key: {"heldout": {"rmse": {"overall": value}}} for key, value in zip(("nominal", "refit", "final"), (nominal, refit, final))}


def case(kind, *names, leading=(), **parameters):
    effects = [{"name": name, "joint": "hinge", "parameters": parameters} for name in names]
    return {"case": {"kind": kind, "effects": effects, "leading": list(leading)}, "floor": {"heldout/00": {"hinge": 0.001}}}


CASES = {
    "rig-0001": (
        case("single", "command_delay", time=0.02),
        {"verdict": "explained", "accepted": [accepted("command_delay", time=(0.022, [0.019, 0.024]))], **errors(0.05, 0.041, 0.005)},
    ),
    "rig-0002": (
        case("single", "backlash", gap=0.04),
        {"verdict": "explained", "accepted": [accepted("command_delay", time=(0.01, None))], **errors(0.05, 0.04, 0.03)},
    ),
    "rig-0003": (
        case("single", "sensor_offset", offset=0.05),
        {"verdict": "indistinguishable", "indistinguishable": [["sensor_offset", "external_force"]], **errors(0.05, 0.04, 0.002)},
    ),
    "rig-0004": (case("none"), {"verdict": "no_missing_effect", **errors(0.002, 0.001, 0.001)}),
    "rig-0005": (case("none"), {"verdict": "explained", "accepted": [accepted("backlash")], **errors(0.002, 0.001, 0.001)}),
    "rig-0006": (
        case("outside", "cable_spring", leading=["position"]),
        {"verdict": "unexplained", "unexplained": {"depends_on": ["position", "velocity"]}, **errors(0.05, 0.04, 0.01)},
    ),
    "rig-0007": (case("single", "position_ripple", amplitude=2.0, phase=0.0, frequency=1.0), {}),
}


@pytest.fixture
def judged(tmp_path):
    for name, (truth, report) in CASES.items():
        for folder, content in (("truth", truth), ("results", {"report": report})):
            (tmp_path / folder).mkdir(exist_ok=True)
            (tmp_path / folder / f"{name}.json").write_text(json.dumps(content))
    return summary.load(tmp_path, tmp_path / "results")


def test_names_false_alarms_and_leading_variables_are_counted(judged):
    text = summary.tables(judged)
    for line in (
        "single: right name, no wrong one | 2 of 4 (50 %)",
        "... and nothing is said to be left | 2 of 4 (50 %)",
        "none: false alarms | 1 of 2 (50 %)",
        "outside: and the right leading variable | 1 of 1 (100 %)",
        "95 % intervals that hold the truth | 1 of 1 (100 %)",
        "| backlash | command_delay (1) |",
        "| sensor_offset | external_force/sensor_offset (1) |",
        "| position_ripple | no_report (1) |",
        "| command_delay | time | 1 | 10.0 % | 1 of 1 (100 %) |",
        "| none (2) | 2.00 | 1.00 | - | 1.00 | 1.00 |",
    ):
        assert line in text, text
    delay = judged[0]
    assert delay.gap_closed() == pytest.approx((0.041 - 0.005) / 0.040)
    assert math.isnan(judged[3].gap_closed()), "re-tuning left nothing to close"


def test_errors_are_of_the_cases_that_have_every_effect_at_once(judged):
    judged[0].report["all_effects"] = {"heldout": {"rmse": {"overall": 0.006}}}
    text = summary.tables(judged)
    assert "| single (1) | 50.00 | 41.00 | 6.00 | 5.00 | 1.00 |" in text and "| none (0) | - | - | - | - | - |" in text, text


def test_machines_are_counted_apart_too(judged):
    judged[0].name = "leg-0000"
    lines = summary.tables(judged).splitlines()
    assert lines[0] == f"| figure | all ({len(judged)}) | leg (1) | rig ({len(judged) - 1}) | to reach |"
    assert lines[2] == "| single: right name, no wrong one | 2 of 4 (50 %) | 1 of 1 (100 %) | 1 of 3 (33 %) | 90 % |"


def test_a_truth_that_is_not_there_is_made_again(tmp_path):
    results = tmp_path / "results"
    results.mkdir()
    runner.write(results / "rig-1000.json", {"report": CASES["rig-0004"][1]})
    (outcome,) = summary.load(tmp_path / "made", results)
    assert (outcome.kind, outcome.verdict) == ("none", "no_missing_effect")


@pytest.mark.parametrize(
    ("names", "sets", "right"),
    [
        (["backlash"], [], True),
        (["backlash", "elasticity"], [], False),
        (["command_delay"], [["backlash", "command_delay"]], True),
        (["backlash"], [["payload", "mass"]], False),
        ([], [["payload", "backlash"]], True),
    ],
)
def test_a_wrong_name_or_set_beside_a_right_one_is_wrong(names, sets, right):
    effects = [{"name": "backlash", "joint": "hinge"}]
    outcome = summary.Outcome("rig-0001", "single", effects, [], 0.001, {"verdict": "unexplained"}, accepted=names, sets=sets)
    assert (outcome.named(), outcome.right(), outcome.exact()) == (True, right, False)


def test_the_truth_of_a_ripple_is_in_the_terms_of_reports():
    values = summary.true_parameters({"name": "position_ripple", "parameters": {"amplitude": 2.0, "phase": 0.5, "frequency": 1.5}})
    assert values["sine"] ** 2 + values["cosine"] ** 2 == pytest.approx(4.0) and values["frequency"] == 1.5


def test_a_run_goes_on_where_it_stopped(tmp_path, monkeypatch):
    program = tmp_path / "program.py"
    program.write_text(
        "import json, pathlib, sys\n"
        "out = pathlib.Path(sys.argv[sys.argv.index('--out') + 1])\n"
        "logs = sys.argv[2:sys.argv.index('--robot')]\n"
        "out.mkdir(parents=True, exist_ok=True)\n"
        "(out / 'report.json').write_text(json.dumps({'verdict': 'explained', 'more': len(logs)}))\n"
    )
    made = []

    def ensure(machine, seed, out):
        made.append(seed)
        folder = out / "cases" / f"{machine}-{seed}"
        for part in ("fit", "heldout"):
            (folder / part).mkdir(parents=True)
            (folder / part / "a.mcap").write_bytes(b"")
        return folder

    monkeypatch.setattr(cases, "ensure", ensure)
    begun = tmp_path / "found" / "rig-0002"
    begun.mkdir(parents=True)
    (begun / "unfinished").touch()
    for chosen in ([("rig", 1)], [("rig", 1), ("rig", 2)]):
        runner.run(chosen, [sys.executable, str(program)], tmp_path, tmp_path / "results", 60.0)
    assert made == [1, 2]
    results = [json.loads((tmp_path / "results" / f"rig-000{seed}.json").read_text()) for seed in (1, 2)]
    assert [result["resumed"] for result in results] == [False, True]
    assert all((result["code"], result["report"]) == (0, {"verdict": "explained"}) for result in results)
    assert not list((tmp_path / "found").iterdir())
    assert not list((tmp_path / "results").glob("*.part"))


def test_the_fixed_list_is_a_hundred_cases_of_which_a_quarter_is_healthy():
    from sealed.effects import KINDS

    assert len(set(cases.FIXED)) >= 100
    healthy = [KINDS[seed % len(KINDS)] for _, seed in cases.FIXED].count("none")
    assert healthy / len(cases.FIXED) >= 0.25
    assert not set(cases.FIXED) & {*cases.REHEARSAL, *cases.FIRST}


@pytest.mark.parametrize(
    ("first", "right"), [("position", True), ("position of hinge", True), ("position of other", False), ("torque", False)]
)
def test_a_leading_variable_is_right_where_it_is_of_the_right_joint(first, right):
    outcome = summary.Outcome(
        *("leg-0001", "outside", [{"name": "cable_spring", "joint": "hinge"}], ["position"], 0.001),
        report={"verdict": "unexplained", "unexplained": {"depends_on": [first, "time"]}},
    )
    assert outcome.led() == right
