//! A rehearsal: the controller in its own process, the simulated robot in another, in real time.
//!
//! ```text
//! robot: physics and sensors at its rate --latency--> controller: steps at its own pace
//!        targets hold until others come  <-- targets, status --
//! ```
//!
//! The latency is drawn once, as for an episode of training, and its jitter once a control period; they mean what they mean there:
//! how old readings are when the policy acts on them. The two processes add what they add.
//!
//! Either process may stop or die: the robot's servos hold their last targets, the controller holds, then goes to the nominal
//! pose; a controller that died is started again, and one whose robot died ends.

pub mod brain;
mod clock;
mod record;
mod report;
pub mod robot;
mod wire;

pub use wire::Line;

pub use report::Report;
