//! CSV and JSON through column maps: values in SI units, labels, overrides, repeats; faults are named with their place.

use std::fs;
use std::path::PathBuf;

use omniwalk_env::robot::Source;
use omniwalk_sim2real::check::{Check, Fault};
use omniwalk_sim2real::recording::{CommandKind, Map, Recording, RecordingError, read};
use proptest::prelude::*;

const CSV_MAP: &str = r#"
time = { column = "t", unit = "ms" }
segment = "run"
voltage = { column = "mv", unit = "mV" }
[groups]
stand = "left"
shape = { column = "shape" }
[overrides]
kp = { field = "gain", scale = 0.5, offset = 1.0 }
"payload.mass" = 0.49
[[joint]]
names = ["hip", "knee"]
command = { column = "{joint}.goal", unit = "N m" }
position = { column = "{joint}.pos", scale = 2.0, offset = -180.0, unit = "deg" }
enabled = { column = "on" }
extra = { load = { column = "load", signed_bits = 16 } }
"#;

const URDF: &str = r#"<robot name="arm"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="a" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="5" velocity="8"/></joint></robot>"#;

const CSV: &str = "\u{feff}# gain: 3\n# by: hand\nrun,shape,t,hip.goal,hip.pos,knee.goal,knee.pos,on,load,mv\n\
a,sine,1000,0.5,90,0.1,180,true,65535,7400\n\
a,sine,1010,0.6,91,,180,true,1,7300\n\
b,step,1020,0.7,92,0.3,,False,2,\n\
b,step,1030,0.7,93,0.3,180,0,2,7200\n";

fn map(text: &str) -> Map {
    let source = Source {
        file: "map.toml".into(),
        text: text.into(),
    };
    Map::parse(&source).unwrap()
}

/// What reading a file of this name and content gives.
fn reading(name: &str, content: &[u8], map: &Map) -> Result<Vec<Recording>, RecordingError> {
    let folder = tempfile::tempdir().unwrap();
    let path: PathBuf = folder.path().join(name);
    fs::write(&path, content).unwrap();
    read(&path, Some(map))
}

#[test]
fn a_csv_file_becomes_a_recording_per_segment_in_si_units() {
    let recordings = reading("log.csv", CSV.as_bytes(), &map(CSV_MAP)).unwrap();
    let names: Vec<&str> = recordings.iter().map(|recording| recording.name.as_str()).collect();
    assert_eq!(names, ["log:a", "log:b"]);
    let first = &recordings[0];
    assert_eq!(
        (first.groups["stand"].as_str(), first.groups["shape"].as_str()),
        ("left", "sine")
    );
    assert_eq!((first.overrides["kp"], first.overrides["payload.mass"]), (2.5, 0.49));
    assert_eq!(first.voltage.value, [7.4, 7.3]);
    let hip = first.joint("hip").unwrap();
    assert_eq!(
        (hip.command_kind, hip.command.value.clone()),
        (CommandKind::Effort, vec![0.5, 0.6])
    );
    assert!((hip.position.value[1] - 2_f64.to_radians()).abs() < 1e-15);
    assert_eq!(hip.position.time, [0.0, 0.01]);
    assert_eq!(hip.extra["load"].value, [-1.0, 1.0]);
    let knee = recordings[1].joint("knee").unwrap();
    assert_eq!(
        (knee.position.time.clone(), knee.enabled.value.clone()),
        (vec![0.01], vec![0.0, 0.0])
    );
    assert_eq!(
        recordings[0].joint("knee").unwrap().command.len(),
        1,
        "an empty cell is no command"
    );
}

#[test]
fn rows_of_json_and_lists_of_json_say_the_same() {
    let common = "time = { column = \"t\" }\n[groups]\nwho = { field = \"about.who\" }\n[[joint]]\nnames = [\"a\"]\n";
    let rows = map(&format!(
        "rows = \"data.rows\"\n{common}position = {{ column = \"q.1\" }}\n"
    ));
    let lists = map(&format!("{common}position = {{ column = \"q\" }}\n"));
    let as_rows = br#"{"data": {"rows": [{"t": 0, "q": [9, 1], "z": {"t": 5}}, {"q": [9, 2.5], "t": 1, "n": [[1]]}]}, "about": {"who": "me"}}"#;
    let as_lists = br#"{"t": [0, 1], "q": [1, 2.5], "other": ["x"], "about": {"who": "me"}}"#;
    let [a, b] = [("a.json", &as_rows[..], rows), ("a.json", as_lists, lists)]
        .map(|(name, text, map)| reading(name, text, &map).unwrap());
    assert_eq!(a, b);
    assert_eq!(a[0].joints[0].position.value, [1.0, 2.5]);
    assert_eq!(a[0].groups["who"], "me");
}

#[test]
fn faults_in_files_are_named_with_line_and_column() {
    let csv = map(CSV_MAP);
    let json =
        map("rows = \"e\"\ntime = { column = \"t\" }\n[[joint]]\nnames = [\"a\"]\nposition = { column = \"q\" }\n");
    let runs = map(
        "rows = \"e\"\nsegment = \"run\"\ntime = { column = \"t\" }\n[[joint]]\nnames = [\"a\"]\nposition = { column = \"q\" }\n",
    );
    let back = CSV.replace("1010", "990");
    let word = CSV.replace("91,", "fast,");
    let infinite = CSV.replace("91,", "-inf,");
    let short = CSV.replace("180,true,1,7300", "180");
    let none = CSV.replace("knee.pos", "knee.angle");
    let changing = CSV.replace("a,sine,1010", "a,ramp,1010");
    let no_gain = CSV.replace("gain", "kp");
    let commas = CSV.replace("0.6,91", "0,6,9,1");
    let twice = CSV.replace("load,mv", "load,mv,hip.pos");
    let truth = CSV.replace("91,", "true,");
    let off = CSV.replace("gain: 3", "gain: -3");
    let again = "{\"e\": [{\"t\": 0, \"q\": 1}, {\"q\": 1, \"t\": 1, \"q\": 2}]}";
    for (name, text, map, place, why) in [
        ("a.csv", back.as_str(), &csv, "line 5", "time goes backwards"),
        ("a.csv", &word, &csv, "line 5", "column `hip.pos`: `fast` is no number"),
        (
            "a.csv",
            &infinite,
            &csv,
            "line 5",
            "column `hip.pos`: `-inf` is no number",
        ),
        ("a.csv", &short, &csv, "line 5", "the row ends before column"),
        ("a.csv", &none, &csv, "the first row", "no column `knee.pos`"),
        ("a.csv", &changing, &csv, "line 5", "`shape` changes from sine to ramp"),
        ("a.csv", &no_gain, &csv, "the header", "no field `gain`"),
        (
            "a.csv",
            &commas,
            &csv,
            "line 5",
            "the row has 12 cells, and there are 10 names",
        ),
        (
            "a.csv",
            &twice,
            &csv,
            "the first row",
            "columns 5 and 11 are both called `hip.pos`",
        ),
        (
            "a.csv",
            &truth,
            &csv,
            "line 5",
            "`true` is no number: only columns of `enabled` and `extra`",
        ),
        (
            "a.csv",
            &off,
            &csv,
            "the header, field `gain`",
            "override `kp` cannot be -0.5",
        ),
        ("a.json", again, &json, "line 1, column 49", "row 1 gives `q` twice"),
        (
            "a.json",
            "{\"e\": [{\"t\": 0, \"q\": false}]}",
            &json,
            "line 1",
            "row 0: column `q`: `false` is no number",
        ),
        ("a.csv", "t,q\n", &json, "the file", "no rows"),
        (
            "a.json",
            "{\"e\": [{\"t\": 0, \"q\": \"x\"}]}",
            &json,
            "line 1, column 24",
            "row 0: column `q`: `x` is no number",
        ),
        (
            "a.json",
            "{\"e\": [{\"t\": 0, \"q\": 1}",
            &json,
            "line 1, column 23",
            "EOF",
        ),
        ("a.json", "{\"f\": []}", &json, "the file", "there are no rows at `e`"),
        (
            "a.json",
            "{\"e\": [{\"t\": 0}]}",
            &json,
            "the file",
            "no row has a number in `q`",
        ),
        (
            "a.json",
            "{\"e\": [{\"t\": 0, \"q\": 1}]}",
            &runs,
            "the file",
            "no row has a text in `run`",
        ),
        ("a.bin", "x", &json, "the file", "its name does not tell"),
    ] {
        let text = reading(name, text.as_bytes(), map).expect_err(why).to_string();
        assert!(text.contains(place) && text.contains(why), "{text}");
    }
}

#[test]
fn faults_in_maps_are_named_with_line_and_column() {
    let joint = "[[joint]]\nnames = [\"a\"]\n";
    for (text, line, why) in [
        ("tiem = 3".to_owned(), 1, "unknown field `tiem`"),
        (
            format!("{joint}position = {{ column = \"{}\" }}", "{joint}".repeat(999)),
            3,
            "a column's name would have 7992 bytes",
        ),
        (
            format!("{joint}position = {{ column = \"q\", unit = \"rpm\" }}"),
            3,
            "`rpm` is no unit",
        ),
        (
            format!("{joint}position = {{ column = \"q\", scale = 0.0 }}"),
            3,
            "scale 0",
        ),
        (
            format!("{joint}\nextra = {{ load = {{ column = \"l\", signed_bits = 99 }} }}"),
            4,
            "signed_bits is the width",
        ),
        (format!("{joint}{joint}"), 3, "`a` is named twice"),
        (
            "[[joint]]\nnames = [\"a\", \"b\"]\nposition = { column = \"q\" }".to_owned(),
            1,
            "that of 2 joints",
        ),
        (
            "\n[overrides]\nkp = { field = \"a\", column = \"b\" }".to_owned(),
            3,
            "neither a finite number",
        ),
        ("[overrides]\nkp = \"high\"".to_owned(), 2, "an override is a number"),
        ("[overrides]\n\nkp = -3".to_owned(), 3, "override `kp` cannot be -3"),
        ("[overrides]\nkd = nan".to_owned(), 2, "neither a finite number"),
        (
            "[overrides]\nspeed_limit = 0.0".to_owned(),
            2,
            "override `speed_limit` cannot be 0",
        ),
        (
            "[overrides]\n\"payload.mass\" = 1e10".to_owned(),
            2,
            "cannot be 10000000000",
        ),
        (
            "[overrides]\nstiffness = 3.0".to_owned(),
            2,
            "`stiffness` names no parameter",
        ),
        ("separator = \"\u{e9}\"".to_owned(), 1, "not ASCII"),
    ] {
        let source = Source {
            file: "map.toml".into(),
            text: text.clone(),
        };
        let message = Map::parse(&source).expect_err(&text).to_string();
        assert!(
            message.starts_with(&format!("map.toml:{line}:")) && message.contains(why),
            "{text}: {message}"
        );
    }
}

#[test]
fn separators_at_the_end_of_rows_and_lists_that_are_there_twice() {
    let map = |rows: &str| {
        map(&format!(
            "{rows}time = {{ column = \"t\" }}\n[[joint]]\nnames = [\"a\"]\nposition = {{ column = \"q\" }}\n"
        ))
    };
    let read = reading("a.csv", b"t,q\n0,1,\n1,2,,\n", &map("")).unwrap();
    assert_eq!(
        read[0].joints[0].position.value,
        [1.0, 2.0],
        "empty cells are of no column"
    );
    for (text, rows) in [
        ("{\"t\": [0, 1], \"q\": [1, 2], \"t\": [2, 3]}", ""),
        (
            "{\"e\": [{\"t\": 0, \"q\": 1}], \"e\": [{\"t\": 1, \"q\": 1}]}",
            "rows = \"e\"\n",
        ),
    ] {
        let refused = reading("a.json", text.as_bytes(), &map(rows)).unwrap_err().to_string();
        assert!(refused.contains("is there twice"), "{refused}");
    }
}

/// A last row whose time is far off, as a clock that is set makes: reading and checking take no memory by the time between.
#[test]
fn times_that_jump_are_read_and_refused_by_the_check() {
    let map = map("time = { column = \"t\" }\n[[joint]]\nnames = [\"a\"]\nposition = { column = \"q\" }\n");
    let rows: String = (0..400)
        .map(|i| format!("{},{}\n", f64::from(i) * 0.01, f64::from(i).sin()))
        .collect();
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("a.urdf"), URDF).unwrap();
    let robot = omniwalk_env::robot::load(&folder.path().join("a.urdf")).unwrap();
    for (last, words) in [("1e300", "1.0e300 s"), ("2592003.99", "30.0 days")] {
        let text = format!("t,q\n{rows}{last},0\n");
        let recordings = reading("a.csv", text.as_bytes(), &map).unwrap();
        let check = Check::new(&recordings, &robot);
        let refused = check.refusals[0].to_string();
        assert_eq!(check.refusals[0].fault, Fault::ClockJump, "{check}");
        assert!(
            refused.contains("a: a: time jumps") && refused.contains(words),
            "{refused}"
        );
        assert!(
            refused.contains("is after 3.99 s") && refused.contains("split the log there"),
            "{refused}"
        );
    }
}

#[test]
fn the_maps_of_the_documentation_are_maps() {
    let docs = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/maps"));
    for name in ["bam_xl330", "bam_sts3250", "emps", "poppy"] {
        Map::load(&docs.join(name).with_extension("toml")).unwrap();
    }
    let text = fs::read_to_string(docs.join("README.md")).unwrap();
    let example = text.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next());
    map(example.unwrap());
}

#[test]
fn a_file_without_a_map_asks_for_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    fs::write(&path, CSV).unwrap();
    let text = format!("{:?}", miette::Report::new(read(&path, None).unwrap_err()));
    assert!(text.contains("--map"), "{text}");
}

proptest! {
    #[test]
    fn damaged_files_end_in_an_error_or_a_recording(at: prop::sample::Index, byte: u8, cut: bool) {
        let json = r#"{"k": 4, "e": [{"t": 0.5, "q": 1, "v": null, "on": true}, {"t": 1.5, "q": 2e3, "v": 3, "on": 0}]}"#;
        let json_map = "rows = \"e\"\ntime = { column = \"t\" }\n[overrides]\nkp = { field = \"k\" }\n[[joint]]\n\
                        names = [\"a\"]\nposition = { column = \"q\" }\nvelocity = { column = \"v\" }\nenabled = { column = \"on\" }\n";
        for (name, text, map) in [("a.csv", CSV, map(CSV_MAP)), ("a.json", json, map(json_map))] {
            let mut bytes = text.as_bytes().to_vec();
            let at = at.index(bytes.len());
            if cut { bytes.truncate(at) } else { bytes[at] = byte }
            for recording in reading(name, &bytes, &map).into_iter().flatten() {
                for joint in &recording.joints {
                    prop_assert!(joint.position.time.windows(2).all(|pair| pair[0] < pair[1]));
                    prop_assert!(joint.position.value.iter().all(|value| value.is_finite()));
                }
            }
        }
    }

    #[test]
    fn any_text_as_a_map_is_refused_or_read(text in "\\PC{0,200}") {
        let _ = Map::parse(&Source { file: "map.toml".into(), text });
    }
}

/// A map and a file of 10 kB each, rows by columns and segments by joints, came to gigabytes.
#[test]
fn maps_of_very_many_columns_and_files_of_very_many_segments_are_refused() {
    let names: Vec<String> = (0..1000).map(|i| format!("\"j{i}\"")).collect();
    let names = names.join(",");
    let extra: Vec<String> = (0..100).map(|i| format!("c{i}={{column=\"{{joint}}{i}\"}}")).collect();
    let text = format!(
        "time={{column=\"t\"}}\n[[joint]]\nnames=[{names}]\nextra={{{}}}\n",
        extra.join(",")
    );
    let source = Source {
        file: "map.toml".into(),
        text,
    };
    let refused = Map::parse(&source).unwrap_err().to_string();
    assert!(refused.contains("100000 columns"), "{refused}");

    let map = map(&format!(
        "time={{column=\"t\"}}\nsegment=\"s\"\n[[joint]]\nnames=[{names}]\n"
    ));
    let rows: String = (0..2000).map(|row| format!("{row},{row}\n")).collect();
    let refused = reading("log.csv", format!("t,s\n{rows}").as_bytes(), &map).unwrap_err();
    assert!(
        refused.to_string().contains("2000 segments of 1000 joints"),
        "{refused}"
    );
}
