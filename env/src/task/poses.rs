//! World poses of the links the task looks at, for every world of an engine.

use nalgebra::IsometryMatrix3;

use crate::engine::Engine;
use crate::robot::Robot;

/// Poses of feet and of the links that must not overlap.
pub struct Poses {
    links: Vec<usize>,
    /// Per link of the robot, its place in `links`.
    places: Vec<Option<usize>>,
    worlds: usize,
    /// Entry `place * worlds + w`.
    poses: Vec<IsometryMatrix3<f64>>,
}

impl Poses {
    /// Of `robot` in `worlds` worlds; [`Poses::look`] fills them.
    pub fn new(robot: &Robot, worlds: usize) -> Self {
        let feet = robot.feet.iter().map(|foot| foot.link);
        let mut links: Vec<usize> = feet
            .chain(robot.overlap_pairs.iter().flat_map(|&(a, b)| [a, b]))
            .collect();
        links.sort_unstable();
        links.dedup();
        Self {
            places: (0..robot.links.len())
                .map(|link| links.iter().position(|&other| other == link))
                .collect(),
            poses: vec![IsometryMatrix3::identity(); links.len() * worlds],
            links,
            worlds,
        }
    }

    /// Takes over the poses after the engine's last step.
    pub fn look(&mut self, engine: &mut dyn Engine) {
        engine.link_poses(&self.links, &mut self.poses);
    }

    /// Pose of `link` in `world`.
    ///
    /// # Panics
    /// When `link` is none of the links looked at.
    pub fn of(&self, world: usize, link: usize) -> &IsometryMatrix3<f64> {
        let place = self.places[link].expect("feet and overlapping links are looked at");
        &self.poses[place * self.worlds + world]
    }
}
