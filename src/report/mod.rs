//! Pictures of runs and the page that holds them: learning curves, the gait of a rollout and what it asks of
//! the joints, a filmstrip of it, what an evaluation measured.
//!
//! Pictures are drawn in memory at twice their size and averaged down, which smooths every edge alike, with a font that
//! is compiled in: the same files give the same bytes on every machine, with fonts installed or without.

pub mod again;
pub mod canvas;
pub mod commands;
pub mod curves;
pub mod evaluation;
pub mod film;
pub mod gait;
pub mod health;
pub mod html;
pub mod identification;
pub mod learning;
pub mod load;
pub mod motion;
pub mod plot;
pub mod polar;
pub mod ray;
pub mod residual;
pub mod subject;

use miette::Diagnostic;
use thiserror::Error;

/// Why a picture cannot be made.
#[derive(Debug, Error, Diagnostic)]
pub enum ReportError {
    /// Drawing or encoding failed.
    #[error("cannot draw: {0}")]
    Draw(String),
    /// A rollout is not one of this robot, or holds nothing that can be drawn.
    #[error("{}: {why}", .path.display())]
    Rollout {
        /// The log.
        path: std::path::PathBuf,
        /// What is wrong with it.
        why: String,
    },
}

impl ReportError {
    fn draw(error: impl std::fmt::Display) -> Self {
        Self::Draw(error.to_string())
    }
}
