//! How a report reaches the terminal.

use std::fmt::Write;

use miette::{Diagnostic, Report};

/// Longest line of a source that is drawn, bytes: longer ones fill terminals, and beyond 65,535 drawing panics in the library.
const WIDEST: usize = 1_000;
/// Longest sentence, characters: some repeat the value that is wrong.
const LONGEST: usize = 1_000;

/// The report with its snippet, or, where a line of the source is too long to draw, with file, line and column alone.
pub fn text(report: &Report) -> String {
    if drawable(report.as_ref()) {
        format!("{report:?}")
    } else {
        format!("Error: {}", plain(report))
    }
}

/// The report without drawings: what is wrong and why, file, line and column, help.
pub fn plain(report: &Report) -> String {
    let mut text = String::new();
    sentence(report.as_ref(), &mut text);
    text
}

fn drawable(diagnostic: &dyn Diagnostic) -> bool {
    let fits = places(diagnostic).iter().all(|place| place.widest <= WIDEST);
    let says = diagnostic.to_string().len() <= LONGEST
        && diagnostic
            .source()
            .is_none_or(|cause| cause.to_string().len() <= LONGEST);
    fits && says && diagnostic.related().is_none_or(|mut others| others.all(drawable))
}

struct Place {
    text: String,
    /// Bytes of the longest line that would be drawn.
    widest: usize,
}

fn places(diagnostic: &dyn Diagnostic) -> Vec<Place> {
    let (Some(source), Some(labels)) = (diagnostic.source_code(), diagnostic.labels()) else {
        return Vec::new();
    };
    let place = |label: miette::LabeledSpan| {
        let contents = source.read_span(label.inner(), 0, 0).ok()?;
        let (line, column) = (contents.line() + 1, contents.column() + 1);
        let around = source.read_span(label.inner(), 1, 1).ok()?;
        let lines = around.data().split(|byte| *byte == b'\n');
        Some(Place {
            text: format!("{}:{line}:{column}", contents.name().unwrap_or("input")),
            widest: lines.map(<[u8]>::len).max().unwrap_or_default(),
        })
    };
    labels.filter_map(place).collect()
}

/// The sentence without its middle if it is too long.
fn shortened(text: String) -> String {
    let count = text.chars().count();
    if count <= LONGEST {
        return text;
    }
    let half = LONGEST / 2;
    let (start, end): (String, String) = (
        text.chars().take(half).collect(),
        text.chars().skip(count - half).collect(),
    );
    format!("{start} [...] {end}")
}

fn sentence(diagnostic: &dyn Diagnostic, text: &mut String) {
    *text += &shortened(diagnostic.to_string());
    let mut cause = diagnostic.source();
    while let Some(error) = cause {
        let _ = write!(text, ": {}", shortened(error.to_string()));
        cause = error.source();
    }
    let places: Vec<String> = places(diagnostic).into_iter().map(|place| place.text).collect();
    if !places.is_empty() {
        let _ = write!(text, " [{}]", places.join(", "));
    }
    if let Some(help) = diagnostic.help() {
        let _ = write!(text, "\n  help: {help}");
    }
    for other in diagnostic.related().into_iter().flatten() {
        text.push('\n');
        sentence(other, text);
    }
}
