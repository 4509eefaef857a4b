//! The one error of the configuration layer: what is wrong, where, and what would be right.

use std::fmt;

use miette::{Diagnostic, LabeledSpan, NamedSource, SourceCode};

/// A configuration that cannot be used.
///
/// As a [`Diagnostic`] it shows the file (or the `--set` argument) with line and column, underlines the key or
/// value, and says what would be right.
#[derive(Debug)]
pub struct ConfigError {
    message: String,
    help: Option<String>,
    place: Option<Box<(NamedSource<String>, LabeledSpan)>>,
    others: Vec<ConfigError>,
}

impl ConfigError {
    /// An error that has no place in a text, such as a file that cannot be read.
    pub(crate) fn new(message: impl Into<String>) -> Self {
        Self {
            message: message.into(),
            help: None,
            place: None,
            others: Vec::new(),
        }
    }

    /// Says what would be right.
    pub(crate) fn with_help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }

    /// Underlines `span` (bytes) of `text`, which the user knows as `name`.
    pub(crate) fn at(mut self, name: &str, text: &str, span: std::ops::Range<usize>, label: &str) -> Self {
        let label = LabeledSpan::new_with_span(Some(label.to_owned()), span);
        self.place = Some(Box::new((NamedSource::new(name, text.to_owned()), label)));
        self
    }

    /// Joins several errors into one report; the first one leads.
    pub(crate) fn join(errors: Vec<ConfigError>) -> Option<Self> {
        let mut errors = errors.into_iter();
        let mut first = errors.next()?;
        first.others.extend(errors);
        Some(first)
    }
}

impl fmt::Display for ConfigError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for ConfigError {}

impl Diagnostic for ConfigError {
    fn help<'a>(&'a self) -> Option<Box<dyn fmt::Display + 'a>> {
        self.help.as_ref().map(|help| Box::new(help) as Box<dyn fmt::Display>)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.place.as_ref().map(|place| &place.0 as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let label = &self.place.as_ref()?.1;
        Some(Box::new(std::iter::once(label.clone())))
    }

    fn related<'a>(&'a self) -> Option<Box<dyn Iterator<Item = &'a dyn Diagnostic> + 'a>> {
        if self.others.is_empty() {
            return None;
        }
        Some(Box::new(self.others.iter().map(|error| error as &dyn Diagnostic)))
    }
}
