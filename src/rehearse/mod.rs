//! A rehearsal: the controller in its own process, the simulated robot in another, in real time.
//!
//! ```text
//! robot: physics at its rate; sensors at the control rate --latency, jitter--> controller: steps at its own pace
//!        targets hold until others come  <-------------- targets, status -----
//! ```
//!
//! Either process may stop or die: the robot's servos hold their last targets, the controller holds, then goes to the nominal
//! pose; a controller that died is started again.

pub mod brain;
mod clock;
mod record;
mod report;
pub mod robot;
mod wire;

/// Names of the sockets in their folder.
const BRAIN: &str = "controller";
const ROBOT: &str = "robot";

pub use report::Report;
