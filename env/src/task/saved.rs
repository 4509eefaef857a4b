//! What was read from a checkpoint before it is used: a file can be of the right kind and still of another shape.

use super::environment::Environment;

impl Environment {
    /// Whether every list is as long as in `own`, which was made for this robot and configuration, and every index within its list.
    pub fn has_shape_of(&self, own: &Self) -> bool {
        let lengths = |e: &Self| {
            [
                e.response.len(),
                e.targets.len(),
                e.previous_targets.len(),
                e.soles.len(),
                e.index,
            ]
        };
        lengths(self) == lengths(own)
            && self.swing.leg() < 2
            && self.pipeline.has_shape_of(&own.pipeline)
            && self.history.has_shape_of(&own.history)
            && self.gait.has_shape_of(&own.gait)
            && self.tracking.has_shape_of(&own.tracking)
    }
}
