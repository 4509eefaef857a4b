//! The commands, one file each.

pub mod bench;
pub mod eval;
pub mod excite;
pub mod inspect;
pub mod report;
pub mod train;

mod load;
