//! `omniwalk view`: the robot in the browser, as it was recorded and as it walks now.
//!
//! ```text
//! orders --websocket--> pilot: controller + engine in real time --> frames --websocket--> the page
//!                         |                                    \--> messages --> Foxglove, MCAP
//! logs --> rows --http--> the page
//! ```
//!
//! The page is embedded in the binary; a request names a part of the page or the number of a log, never a path.

pub mod assets;
pub mod clips;
pub mod describe;
pub mod drive;
pub mod listen;
pub mod live;
pub mod orders;
pub mod pilot;
pub mod row;
pub mod server;
