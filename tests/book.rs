//! The book: every page of it exists, and every command in it is run here, or says in brackets how long it takes.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The pages in the order of the summary.
fn pages() -> Vec<PathBuf> {
    let docs = root().join("docs");
    let summary = fs::read_to_string(docs.join("SUMMARY.md")).unwrap();
    let links = summary.split("](").skip(1);
    links.map(|rest| docs.join(rest.split(')').next().unwrap())).collect()
}

/// Commands and their comments, of the fenced `sh` blocks of a page.
fn commands(page: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for block in page.split("```sh\n").skip(1) {
        let block = block.split("```").next().unwrap();
        for line in block.lines().filter(|line| !line.trim().is_empty()) {
            let (command, comment) = line.split_once(" #").unwrap_or((line, ""));
            found.push((command.trim().to_owned(), comment.trim().to_owned()));
        }
    }
    found
}

/// What is not run here says how long it takes: `(3 min)`, `(hours)`, `(until Ctrl-C)`.
fn is_timed(comment: &str) -> bool {
    let units = ["s", "min", "minute", "minutes", "hour", "hours", "seconds"];
    let brackets = comment.split('(').skip(1).map(|rest| rest.split(')').next().unwrap());
    let word = |text: &str| text.split([' ', ';', ',']).any(|word| units.contains(&word));
    brackets.into_iter().any(|text| text == "until Ctrl-C" || word(text))
}

/// The arguments of a command of the program; `None` for another program.
fn arguments(command: &str) -> Option<Vec<&str>> {
    let rest = command
        .strip_prefix("cargo run --release -- ")
        .or_else(|| command.strip_prefix("omniwalk "))?;
    Some(rest.split_whitespace().collect())
}

fn run(folder: &Path, arguments: &[&str]) {
    let output = Command::cargo_bin("omniwalk")
        .unwrap()
        .current_dir(folder)
        .args(arguments)
        .output()
        .unwrap();
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "omniwalk {}\n{err}", arguments.join(" "));
}

/// A folder like the repository as far as the commands see it, with a run that has learned nothing and a URDF.
fn sandbox() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let copy = |from: &str, to: &str| {
        let to = folder.path().join(to);
        fs::create_dir_all(to.parent().unwrap()).unwrap();
        fs::copy(root().join(from), to).unwrap();
    };
    for file in [
        "configs/forward.toml",
        "robots/nimbro_op2x/nimbro_op2x.urdf",
        "robots/nimbro_op2x/robot.toml",
        "runs/nimbro_op2x_omni/policy.omni",
        "runs/forward/seed-1/eval.json",
    ] {
        copy(file, file);
    }
    copy("robots/nimbro_op2x/nimbro_op2x.urdf", "my_robot.urdf");
    let small = [
        "train.steps_per_update=16",
        "ppo.hidden=[16, 16]",
        "ppo.epochs=1",
        "train.steps=2048",
    ];
    let train = ["train", "configs/forward.toml", "--run", "runs/forward-1", "--quiet"];
    let changes: Vec<&str> = small.iter().flat_map(|change| ["--set", change]).collect();
    run(folder.path(), &[&train[..], &changes].concat());
    folder
}

#[test]
fn the_summary_names_pages_that_exist_and_every_page_is_in_it() {
    let pages = pages();
    assert!(pages.len() >= 15, "{pages:?}");
    for page in &pages {
        assert!(page.is_file(), "{}", page.display());
    }
    for entry in fs::read_dir(root().join("docs")).unwrap() {
        let path = entry.unwrap().path();
        let is_page = path.extension().is_some_and(|ending| ending == "md") && !path.ends_with("SUMMARY.md");
        assert!(
            !is_page || pages.contains(&path),
            "{} is not in the summary",
            path.display()
        );
    }
}

#[test]
fn links_between_pages_lead_somewhere() {
    for page in pages() {
        let text = fs::read_to_string(&page).unwrap();
        for rest in text.split("](").skip(1) {
            let link = rest.split([')', '#']).next().unwrap();
            let elsewhere = link.is_empty() || link.contains("://") || link.contains(char::is_whitespace);
            let target = page.parent().unwrap().join(link);
            assert!(elsewhere || target.exists(), "{} links to {link}", page.display());
        }
    }
}

#[test]
fn every_command_of_the_book_works_or_says_how_long_it_takes() {
    let folder = sandbox();
    let mut ran = 0;
    for page in pages() {
        for (command, comment) in commands(&fs::read_to_string(&page).unwrap()) {
            if is_timed(&comment) {
                continue;
            }
            let place = page.display();
            let arguments = arguments(&command);
            let arguments = arguments.unwrap_or_else(|| panic!("{place}: `{command}` does not say how long it takes"));
            run(folder.path(), &arguments);
            ran += 1;
        }
    }
    assert!(ran >= 10, "{ran} commands were run");
}
