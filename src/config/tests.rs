//! What a user sees for every kind of mistake, and that merging and writing lose nothing.

use std::collections::BTreeMap;

use miette::{GraphicalReportHandler, GraphicalTheme};
use proptest::prelude::*;
use serde::{Deserialize, Serialize};

use super::*;

const DEFAULTS: &str = r#"
[ppo]
discount = 0.99
epochs = 5
hidden = [512, 512]
head = "beta"
[action]
scale = [0.1, 0.2, 0.3]
filter = { type = "butterworth", cutoff_hz = 5.0 }
[train]
name = "default"
seed = 1
mirror = false
"#;

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Config {
    ppo: Ppo,
    action: Action,
    train: Train,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Ppo {
    discount: f64,
    epochs: u32,
    hidden: Vec<usize>,
    head: Head,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(rename_all = "snake_case")]
enum Head {
    Beta,
    Gaussian,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Action {
    scale: [f64; 3],
    filter: Option<Filter>,
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
enum Filter {
    Exponential { gain: f64 },
    Butterworth { cutoff_hz: f64 },
}

#[derive(Debug, Deserialize, PartialEq)]
#[serde(deny_unknown_fields)]
struct Train {
    name: String,
    seed: u64,
    mirror: bool,
}

impl Configuration for Config {
    fn read(table: &mut Table<'_>) -> Result<Self, Fault> {
        table.part()
    }

    fn validate(&self) -> Result<(), Vec<Invalid>> {
        let mut invalid = Vec::new();
        if !(0.0..=1.0).contains(&self.ppo.discount) {
            invalid.push(Invalid::new("ppo.discount", "must be from 0 to 1"));
        }
        if let Some(i) = self.ppo.hidden.iter().position(|&width| width == 0) {
            invalid.push(Invalid::new(format!("ppo.hidden.{i}"), "must be at least 1"));
        }
        if invalid.is_empty() { Ok(()) } else { Err(invalid) }
    }
}

fn layers() -> Layers {
    Layers::new(DEFAULTS).unwrap()
}

/// The report as it reaches the user's terminal, without colours.
fn report(result: Result<Layers, ConfigError>) -> String {
    let error = match result {
        Ok(layers) => layers
            .build::<Config>()
            .expect_err("this configuration should be refused"),
        Err(error) => error,
    };
    let mut text = String::new();
    GraphicalReportHandler::new_themed(GraphicalTheme::unicode_nocolor())
        .with_width(120)
        .render_report(&mut text, &error)
        .unwrap();
    text
}

#[track_caller]
fn assert_says(report: &str, parts: &[&str]) {
    for part in parts {
        assert!(report.contains(part), "{part:?} is not in\n{report}");
    }
}

#[test]
fn defaults_alone_are_a_configuration() {
    let (config, _) = layers().build::<Config>().unwrap();
    assert_eq!(config.ppo.epochs, 5);
    assert_eq!(config.action.filter, Some(Filter::Butterworth { cutoff_hz: 5.0 }));
}

#[test]
fn later_layers_win_key_by_key() {
    let layers = layers()
        .text("a.toml", "[ppo]\nepochs = 10\n[train]\nseed = 3")
        .unwrap();
    let layers = layers.set("train.seed=4").unwrap().set("train.name=first run").unwrap();
    let (config, _) = layers.build::<Config>().unwrap();
    assert_eq!((config.ppo.epochs, config.ppo.discount), (10, 0.99));
    assert_eq!(
        config.train,
        Train {
            name: "first run".into(),
            seed: 4,
            mirror: false
        }
    );
    let keys: Vec<_> = layers
        .changes()
        .into_iter()
        .map(|change| (change.key, change.value))
        .collect();
    let expected = [
        ("ppo.epochs", "10"),
        ("train.name", "\"first run\""),
        ("train.seed", "4"),
    ];
    assert_eq!(keys, expected.map(|(key, value)| (key.to_owned(), value.to_owned())));
}

#[test]
fn a_table_of_another_type_replaces_the_default_one() {
    let layers = layers()
        .text("a.toml", "[action.filter]\ntype = \"exponential\"\ngain = 0.5")
        .unwrap();
    assert_eq!(
        layers.build::<Config>().unwrap().0.action.filter,
        Some(Filter::Exponential { gain: 0.5 })
    );
    let layers = layers.set("action.filter.gain=1").unwrap();
    assert_eq!(
        layers.build::<Config>().unwrap().0.action.filter,
        Some(Filter::Exponential { gain: 1.0 })
    );
}

#[test]
fn set_takes_toml_values_and_bare_words() {
    let value = |argument: &str| layers().set(argument).unwrap().build::<Config>().unwrap().0;
    assert_eq!(value("ppo.hidden=[64, 32]").ppo.hidden, [64, 32]);
    assert_eq!(value("ppo.head=gaussian").ppo.head, Head::Gaussian);
    assert_eq!(value("ppo.head = \"gaussian\"").ppo.head, Head::Gaussian);
    assert_eq!(value("train.name=runs/a-1.b").train.name, "runs/a-1.b");
    assert_eq!(value("ppo.discount=1").ppo.discount, 1.0);
    assert!(value("train.mirror=true").train.mirror);
}

#[test]
fn an_unknown_key_is_shown_with_the_nearest_known_one() {
    let report = report(layers().text("a.toml", "[ppo]\nepochs = 3\ndiscont = 0.9"));
    assert_says(
        &report,
        &[
            "unknown key `ppo.discont`",
            "a.toml:3:1",
            "discont = 0.9",
            "did you mean `ppo.discount`?",
        ],
    );
}

#[test]
fn an_unknown_key_of_another_section_is_shown_with_its_section() {
    let report = report(layers().text("a.toml", "[ppo]\nmirror = true"));
    assert_says(
        &report,
        &["unknown key `ppo.mirror`", "a.toml:2:1", "there is `train.mirror`"],
    );
}

#[test]
fn an_unknown_key_of_a_variant_is_shown_at_the_key() {
    let report = report(layers().text("a.toml", "[action]\nfilter = { type = \"exponential\", gian = 1.0 }"));
    assert_says(
        &report,
        &[
            "unknown key `action.filter.gian`",
            "a.toml:2:34",
            "did you mean `action.filter.gain`?",
        ],
    );
}

#[test]
fn a_wrong_type_is_shown_with_the_expected_one() {
    let wrong = report(layers().text("a.toml", "[ppo]\nepochs = \"many\""));
    assert_says(
        &wrong,
        &[
            "`ppo.epochs` has the wrong type",
            "a.toml:2:10",
            "\"many\"",
            "a whole number, not negative",
        ],
    );
    let negative = report(layers().text("a.toml", "ppo.epochs = -1"));
    assert_says(
        &negative,
        &["a.toml:1:14", "the whole number -1", "a whole number, not negative"],
    );
    let entry = report(layers().text("a.toml", "[ppo]\nhidden = [\n  512,\n  0.5,\n]"));
    assert_says(&entry, &["`ppo.hidden.1`", "a.toml:4:3", "the number 0.5"]);
    let table = report(layers().text("a.toml", "ppo = 5"));
    assert_says(&table, &["`ppo` has the wrong type", "a.toml:1:7", "it takes a table"]);
}

#[test]
fn an_array_of_the_wrong_length_is_refused() {
    assert_says(
        &report(layers().text("a.toml", "action.scale = [1, 2]")),
        &["a.toml:1:16", "action.scale"],
    );
    assert_says(
        &report(layers().text("a.toml", "action.scale = [1, 2, 3, 4]")),
        &["a.toml:1:16", "1 too many"],
    );
}

#[test]
fn an_unknown_choice_lists_the_choices() {
    let report = report(layers().set("ppo.head=gausian"));
    assert_says(
        &report,
        &[
            "`ppo.head` cannot be `gausian`",
            "--set:1:10",
            "did you mean `gaussian`?",
            "beta",
        ],
    );
}

#[test]
fn an_impossible_value_points_at_the_layer_that_wrote_it() {
    let file = report(layers().text("a.toml", "[ppo]\ndiscount = 1.5"));
    assert_says(&file, &["`ppo.discount` must be from 0 to 1", "a.toml:2:12"]);
    let set = report(
        layers()
            .text("a.toml", "[ppo]\ndiscount = 0.5")
            .unwrap()
            .set("ppo.discount=2"),
    );
    assert_says(&set, &["`ppo.discount` must be from 0 to 1", "--set:1:14"]);
    let default = report(Layers::new(&DEFAULTS.replace("0.99", "9.0")));
    assert_says(&default, &["default.toml (built in):3:12"]);
}

#[test]
fn every_impossible_value_is_shown() {
    let report = report(layers().text("a.toml", "[ppo]\ndiscount = 1.5\nhidden = [64, 0]"));
    assert_says(
        &report,
        &["a.toml:2:12", "`ppo.hidden.1` must be at least 1", "a.toml:3:15"],
    );
}

#[test]
fn broken_toml_is_shown_with_its_line() {
    assert_says(
        &report(layers().text("a.toml", "[ppo]\nepochs = = 3")),
        &["a.toml is not valid TOML", "a.toml:2:"],
    );
    assert_says(
        &report(layers().text("a.toml", "a = 1\na = 2")),
        &["a.toml:2:1", "duplicate"],
    );
    assert_says(
        &report(layers().text("a.toml", "ppo.discount = nan")),
        &["a.toml:1:16", "not a number"],
    );
    assert_says(
        &report(layers().text("a.toml", "train.name = 2024-01-01")),
        &["a.toml:1:14", "quotes"],
    );
    assert_says(
        &report(layers().text("a.toml", "train.seed = 99999999999999999999")),
        &["a.toml:1:14", "64 bits"],
    );
}

#[test]
fn a_broken_set_shows_the_argument() {
    for argument in ["ppo.epochs", "=3", "ppo..epochs=3", "train.seed=1\nppo.epochs=2", ""] {
        assert_says(
            &report(layers().set(argument)),
            &["`--set` takes key=value", "--set:1:"],
        );
    }
    for (argument, key) in [
        ("ppo.hidden=[1", "ppo.hidden"),
        ("ppo.discount = nan", "ppo.discount"),
        ("train.seed=NaN", "train.seed"),
    ] {
        assert_says(
            &report(layers().set(argument)),
            &[&format!("the value of `{key}` cannot be used"), "--set:1:"],
        );
    }
    assert_says(
        &report(layers().set("ppo.discount=fast")),
        &["--set:1:14", "string \"fast\"", "it takes a number"],
    );
    assert_says(
        &report(layers().set("pppo.epochs=3")),
        &["unknown key `pppo`", "--set:1:1", "did you mean `ppo`?"],
    );
}

#[test]
fn files_that_are_missing_binary_or_huge_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    assert_says(
        &report(layers().file(&folder.path().join("none.toml"))),
        &["cannot read", "none.toml"],
    );
    assert_says(&report(layers().file(folder.path())), &["cannot read"]);
    assert_says(
        &report(layers().file(&write("b.toml", b"a = \"\xff\""))),
        &["not UTF-8"],
    );
    let huge = vec![b'#'; MAX_FILE_BYTES as usize + 1];
    assert_says(&report(layers().file(&write("h.toml", &huge))), &["larger than 1 MiB"]);
}

/// Any configuration: numbers of every size, strings of every kind, nested tables and arrays.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
struct Anything {
    numbers: Vec<f64>,
    whole: i64,
    tables: BTreeMap<String, BTreeMap<String, Vec<String>>>,
}

impl Configuration for Anything {
    fn read(table: &mut Table<'_>) -> Result<Self, Fault> {
        table.part()
    }

    fn validate(&self) -> Result<(), Vec<Invalid>> {
        Ok(())
    }
}

proptest! {
    #[test]
    fn the_effective_text_gives_the_same_value_again(
        numbers in prop::collection::vec(prop::num::f64::NORMAL | prop::num::f64::ZERO | prop::num::f64::SUBNORMAL, 0..5),
        whole: i64,
        tables in prop::collection::btree_map(
            ".*", prop::collection::btree_map(".*", prop::collection::vec(".*", 0..3), 0..3), 0..3),
    ) {
        let value = Anything { numbers, whole, tables };
        let (first, text) = Layers::new(&toml::to_string(&value).unwrap()).unwrap().build::<Anything>().unwrap();
        prop_assert_eq!(&first, &value);
        let (second, again) = Layers::new(&text).unwrap().build::<Anything>().unwrap();
        prop_assert_eq!(second, value);
        prop_assert_eq!(again, text);
    }

    #[test]
    fn no_text_makes_it_panic(text in "[a-z.=\\[\\]{}\"'0-9#\n -]{0,60}", argument in ".{0,40}") {
        let _ = layers().text("a.toml", &text).map(|layers| layers.build::<Config>());
        let _ = layers().set(&argument).map(|layers| layers.build::<Config>());
    }
}
