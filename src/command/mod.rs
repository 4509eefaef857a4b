//! The commands, one file each.

pub mod bench;
pub mod crosscheck;
pub mod eval;
pub mod excite;
pub mod export;
pub mod guide;
pub mod identify;
pub mod init;
pub mod inspect;
#[cfg(unix)]
pub mod rehearse;
pub mod replay;
pub mod report;
pub mod train;
pub mod view;

pub mod load;
