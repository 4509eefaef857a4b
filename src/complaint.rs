//! How a report reaches the terminal.

use std::fmt::Write;

use miette::{Diagnostic, Report};

/// Snippets are drawn for places up to this column; drawing beyond 65,535 panics in the library.
const WIDEST: usize = 10_000;

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
    let fits = places(diagnostic).iter().all(|place| place.end <= WIDEST);
    fits && diagnostic.related().is_none_or(|mut others| others.all(drawable))
}

struct Place {
    text: String,
    /// Column behind the label.
    end: usize,
}

fn places(diagnostic: &dyn Diagnostic) -> Vec<Place> {
    let (Some(source), Some(labels)) = (diagnostic.source_code(), diagnostic.labels()) else {
        return Vec::new();
    };
    let place = |label: miette::LabeledSpan| {
        let contents = source.read_span(label.inner(), 0, 0).ok()?;
        let (line, column) = (contents.line() + 1, contents.column() + 1);
        Some(Place {
            text: format!("{}:{line}:{column}", contents.name().unwrap_or("input")),
            end: column + label.len(),
        })
    };
    labels.filter_map(place).collect()
}

fn sentence(diagnostic: &dyn Diagnostic, text: &mut String) {
    let _ = write!(text, "{diagnostic}");
    let mut cause = diagnostic.source();
    while let Some(error) = cause {
        let _ = write!(text, ": {error}");
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
