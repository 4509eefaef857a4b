//! A robot whose base is held falls apart into limbs: what hangs on it moves without the rest.

use super::{Base, Joint, Mimic, Robot};
use crate::effect::Site;

/// A part of a robot that moves by itself.
#[derive(Clone, Debug)]
pub struct Limb {
    /// The base and the limb, without what only walking or training needs: feet, mirror, overlap, ranges.
    pub robot: Robot,
    /// Its links in the whole robot, the base first.
    pub links: Vec<usize>,
    /// Its degrees of freedom in the whole robot.
    pub dofs: Vec<usize>,
}

impl Robot {
    /// The limbs of a robot whose base is held, in the order of their first joints; the whole of one that floats. What a mimic joint
    /// follows is of the same limb.
    pub fn limbs(&self) -> Vec<Limb> {
        if self.base == Base::Floating {
            return vec![Limb {
                robot: self.clone(),
                links: (0..self.links.len()).collect(),
                dofs: (0..self.dofs.len()).collect(),
            }];
        }
        let of = self.limb_of_joints();
        let mut first: Vec<usize> = of.clone();
        first.sort_unstable();
        first.dedup();
        let joints = |limb: usize| (0..of.len()).filter(|&joint| of[joint] == limb).collect::<Vec<_>>();
        first.into_iter().map(|limb| self.limb(&joints(limb))).collect()
    }

    /// For every joint the lowest joint of its limb.
    fn limb_of_joints(&self) -> Vec<usize> {
        let mut of: Vec<usize> = Vec::with_capacity(self.joints.len());
        for (i, joint) in self.joints.iter().enumerate() {
            of.push(joint.parent.checked_sub(1).map_or(i, |parent| of[parent]));
        }
        for i in 0..self.joints.len() {
            if let Some(mimic) = self.joints[i].mimic {
                let (a, b) = (of[i].min(of[mimic.joint]), of[i].max(of[mimic.joint]));
                of.iter_mut().filter(|limb| **limb == b).for_each(|limb| *limb = a);
            }
        }
        of
    }

    /// The base with `joints` and what they carry.
    fn limb(&self, joints: &[usize]) -> Limb {
        let links: Vec<usize> = [0].into_iter().chain(joints.iter().map(|joint| joint + 1)).collect();
        let dofs: Vec<usize> = (0..self.dofs.len())
            .filter(|&d| joints.contains(&self.dofs[d]))
            .collect();
        let place = |all: &[usize], one: usize| all.iter().position(|&other| other == one);
        let link = |old: usize| place(&links, old).unwrap_or(0);
        let own = |&old: &usize| {
            let joint = &self.joints[old];
            Joint {
                parent: link(joint.parent),
                mimic: joint.mimic.map(|mimic| Mimic {
                    joint: place(joints, mimic.joint).unwrap_or(0),
                    ..mimic
                }),
                ..joint.clone()
            }
        };
        let mut robot = Self {
            links: links.iter().map(|&old| self.links[old].clone()).collect(),
            joints: joints.iter().map(own).collect(),
            dofs: dofs.iter().filter_map(|&d| place(joints, self.dofs[d])).collect(),
            policy: self.policy.iter().filter_map(|&d| place(&dofs, d)).collect(),
            feet: Vec::new(),
            mirror: None,
            overlap_pairs: Vec::new(),
            effects: Vec::new(),
            ranges: Vec::new(),
            ..self.clone()
        };
        for each in &mut robot.links {
            each.parent = each.parent.map(link);
        }
        for effect in &self.effects {
            let all = if effect.kind.info().site == Site::Joint {
                &dofs
            } else {
                &links
            };
            if let Some(target) = place(all, effect.target) {
                robot.effects.push(crate::effect::Effect {
                    target,
                    ..effect.clone()
                });
            }
        }
        Limb { robot, links, dofs }
    }
}
