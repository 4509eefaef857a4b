//! What all lanes share: the robot's tree as the programs that the phases of a step run.
//!
//! **Mimic joints are eliminated.** A joint moves with degree of freedom d as `q_j = ratio q_d + offset`, so its motion
//! subspace on d's velocity is `S_j = ratio x (axis at the joint)`. Several joints of one path may follow the same
//! degree of freedom; the subspace of d at a link is then the sum of theirs ([`Model::sums`]).
//!
//! **Sparsity.** The mass matrix couples d and e when a link moves with both. Factoring from the last row upwards
//! fills in nothing beyond each row's path to the root of the elimination tree, so row d is stored as the entries of
//! its path: its ancestors in ascending order, then the diagonal. For a robot whose couplings stay within a branch
//! that tree is the kinematic tree; couplings across branches only lengthen paths. The path of an ancestor is a
//! prefix of the path of its descendants.

use std::collections::BTreeSet;

use nalgebra::{Isometry3, Matrix3, Vector3};

use super::contact::Give;
use super::lane::Lane;
use crate::ground::Ground;
use crate::robot::{Base, JointKind, Robot};

/// The degrees of freedom of a floating base: three translations, then three rotations, world axes.
pub const ROOT: usize = 6;

/// Default of [`Model::sweeps`]; they start from the impulses of the last step.
pub const SWEEPS: usize = 5;

/// A moving joint, mimic or not. Joint j carries link j + 1.
pub struct JointModel<L: Lane> {
    /// Link that carries the joint.
    pub parent: usize,
    pub kind: JointKind,
    /// Row of the degree of freedom it moves with.
    pub dof: usize,
    /// `q_j = ratio q_dof + offset`
    pub ratio: L::Scalar,
    pub offset: L::Scalar,
    /// Joint origin in the parent link.
    pub translation: [L::Scalar; 3],
    /// Axis in the parent link.
    pub axis: [L::Scalar; 3],
    /// The child's rotation in the parent is `rest + sin turn_sin + (1 - cos) turn_cos` (Rodrigues), by rows.
    pub rest: [[L::Scalar; 3]; 3],
    pub turn_sin: [[L::Scalar; 3]; 3],
    pub turn_cos: [[L::Scalar; 3]; 3],
    /// Where `S . F` goes for the composite force F of this joint.
    pub products: Vec<Product>,
    /// Where row `dof` starts: the six root entries of F go there (floating base only).
    pub row: usize,
}

/// `mass_matrix[entry] += subspaces[subspace] . F`
#[derive(Clone, Copy)]
pub struct Product {
    pub entry: usize,
    pub subspace: usize,
}

/// A row of the packed mass matrix.
pub struct Row {
    /// Index of its first entry.
    pub start: usize,
    /// The rows of its path to the root, ascending, without itself.
    pub ancestors: Vec<usize>,
}

impl Row {
    /// Index of the diagonal entry.
    #[inline(always)]
    pub fn diagonal(&self) -> usize {
        self.start + self.ancestors.len()
    }
}

/// A link with contact points.
pub struct ContactBody<L: Lane> {
    pub link: usize,
    /// The path of its degrees of freedom, ascending.
    pub path: Vec<usize>,
    /// The subspace at this link of each degree of freedom of `path`; `None` for the root's and for those that do not move it.
    pub subspaces: Vec<Option<usize>>,
    /// Mean of the points, link frame: the reference point of the body's contact wrench.
    pub centre: [L::Scalar; 3],
    /// The points, link frame.
    pub points: Vec<[L::Scalar; 3]>,
    /// Index of its first point among the points of all bodies.
    pub first_point: usize,
}

/// See the module.
pub struct Model<L: Lane> {
    /// Physics step, s.
    pub dt: f64,
    /// How contact points give way.
    pub give: Give,
    /// What the contact points touch.
    pub ground: Ground,
    /// Gauss-Seidel sweeps over all contacts and joints in a step.
    pub sweeps: usize,
    pub floating: bool,
    /// One joint on a fixed base that touches nothing.
    pub one_joint: bool,
    /// Index of the first joint row: 6 or 0.
    pub root: usize,
    /// Orientation and height of a fixed base are constant; the same pose is where idle lanes rest.
    pub base_pose: Isometry3<f64>,
    pub joints: Vec<JointModel<L>>,
    /// `subspaces[joints + k] = subspaces[a] + subspaces[b]` for the k-th `(a, b)`.
    pub sums: Vec<(usize, usize)>,
    /// One a degree of freedom, the root's first.
    pub rows: Vec<Row>,
    /// The rows by the length of their paths: neighbours are of different limbs and wait less for each other than down a limb.
    pub outward: Vec<usize>,
    /// Entries of the packed mass matrix.
    pub entries: usize,
    pub bodies: Vec<ContactBody<L>>,
    /// Contact points of all bodies.
    pub points: usize,
    /// Position limits of the degrees of freedom beside the root's, with those of their mimic joints.
    pub limits: Vec<(L::Scalar, L::Scalar)>,
}

impl<L: Lane> Model<L> {
    /// The programs for `robot` on `ground` at a physics step of `dt` seconds.
    pub fn new(ground: &Ground, robot: &Robot, dt: f64) -> Self {
        let floating = robot.base == Base::Floating;
        let root = if floating { ROOT } else { 0 };
        let tree = Tree::new(robot, root);
        let rows = tree.rows();
        let mut outward: Vec<_> = (0..rows.len()).collect();
        outward.sort_by_key(|&k| rows[k].ancestors.len());
        let entries = rows.iter().map(|row| row.ancestors.len() + 1).sum();
        let joints: Vec<_> = (0..robot.joints.len())
            .map(|j| joint_model(robot, &tree, &rows, j))
            .collect();
        let mut first_point = 0;
        let bodies: Vec<_> = (0..robot.links.len())
            .filter(|&link| !robot.links[link].contact_points.is_empty())
            .filter_map(|link| {
                let body = contact_body(robot, &tree, &rows, link, first_point)?;
                first_point += body.points.len();
                Some(body)
            })
            .collect();
        let limits = (0..robot.dofs.len())
            .map(|d| robot.limits(d))
            .map(|(l, u)| (L::scalar(l), L::scalar(u)));
        Self {
            dt,
            give: Give::new(dt, 1.0),
            ground: ground.clone(),
            sweeps: SWEEPS,
            floating,
            one_joint: !floating && joints.len() == 1 && bodies.is_empty(),
            root,
            base_pose: robot.base_pose,
            joints,
            sums: tree.sums.clone(),
            rows,
            outward,
            entries,
            points: first_point,
            bodies,
            limits: limits.collect(),
        }
    }

    /// Number of degrees of freedom, the root's included.
    #[inline(always)]
    pub fn dofs(&self) -> usize {
        self.rows.len()
    }

    /// Number of links.
    #[inline(always)]
    pub fn links(&self) -> usize {
        self.joints.len() + 1
    }
}

/// Which subspaces move which link.
struct Tree {
    dofs: usize,
    root: usize,
    /// Row of the degree of freedom of each joint.
    dof: Vec<usize>,
    /// Per link, the degrees of freedom that move it beside the root's, each with its subspace there.
    moving: Vec<Vec<(usize, usize)>>,
    sums: Vec<(usize, usize)>,
    /// The joint's own products `(dof, subspace)`.
    products: Vec<Vec<(usize, usize)>>,
}

impl Tree {
    fn new(robot: &Robot, root: usize) -> Self {
        let mut row = vec![0; robot.joints.len()];
        for (d, &j) in robot.dofs.iter().enumerate() {
            row[j] = root + d;
        }
        let dof: Vec<_> = robot
            .joints
            .iter()
            .enumerate()
            .map(|(j, joint)| row[joint.mimic.map_or(j, |m| m.joint)])
            .collect();
        let count = robot.joints.len();
        let mut tree = Self {
            dofs: root + robot.dofs.len(),
            root,
            dof,
            moving: vec![Vec::new()],
            sums: vec![],
            products: vec![],
        };
        for (j, joint) in robot.joints.iter().enumerate() {
            let mut moving = tree.moving[joint.parent].clone();
            let dof = tree.dof[j];
            let mut products;
            if let Some(place) = moving.iter().position(|&(d, _)| d == dof) {
                // The subspace of `dof` changes from C to C + S below this joint, and (C + S)^T I (C + S) - C^T I C = (2 C + S)^T I S.
                let before = moving[place].1;
                tree.sums.push((before, j));
                let after = count + tree.sums.len() - 1;
                moving[place].1 = after;
                products = moving.clone();
                tree.sums.push((before, after));
                products[place].1 = count + tree.sums.len() - 1;
            } else {
                moving.push((dof, j));
                products = moving.clone();
            }
            products.sort_unstable();
            tree.products.push(products);
            tree.moving.push(moving);
        }
        tree
    }

    /// The elimination tree's paths (Liu, The role of elimination trees in sparse factorization, 1990).
    fn rows(&self) -> Vec<Row> {
        let mut coupled = vec![BTreeSet::new(); self.dofs];
        for moving in &self.moving {
            for &(d, _) in moving {
                coupled[d].extend(0..self.root);
                coupled[d].extend(moving.iter().map(|&(e, _)| e).filter(|&e| e < d));
            }
        }
        for (d, lower) in coupled.iter_mut().enumerate().take(self.root) {
            lower.extend(0..d);
        }
        let mut parent = vec![None; self.dofs];
        for d in (0..self.dofs).rev() {
            let Some(&last) = coupled[d].last() else { continue };
            parent[d] = Some(last);
            let rest: Vec<_> = coupled[d].iter().copied().filter(|&e| e < last).collect();
            coupled[last].extend(rest);
        }
        let mut rows: Vec<Row> = Vec::with_capacity(self.dofs);
        let mut start = 0;
        for parent in parent {
            let ancestors = parent.map_or_else(Vec::new, |p: usize| {
                let above: &Row = &rows[p];
                above.ancestors.iter().copied().chain([p]).collect()
            });
            let row = Row { start, ancestors };
            start = row.diagonal() + 1;
            rows.push(row);
        }
        rows
    }
}

fn joint_model<L: Lane>(robot: &Robot, tree: &Tree, rows: &[Row], j: usize) -> JointModel<L> {
    let joint = &robot.joints[j];
    let dof = tree.dof[j];
    let origin = joint.origin.rotation.to_rotation_matrix();
    let axis = joint.axis.into_inner();
    let skew = axis.cross_matrix();
    let (ratio, offset) = joint.mimic.map_or((1.0, 0.0), |m| (m.multiplier, m.offset));
    let products = tree.products[j].iter().map(|&(d, subspace)| {
        let (row, column) = (dof.max(d), dof.min(d));
        Product {
            entry: rows[row].start + rows[column].ancestors.len(),
            subspace,
        }
    });
    JointModel {
        parent: joint.parent,
        kind: joint.kind,
        dof,
        ratio: L::scalar(ratio),
        offset: L::scalar(offset),
        translation: scalars::<L>(joint.origin.translation.vector),
        axis: scalars::<L>(origin * axis),
        rest: matrix::<L>(origin.into_inner()),
        turn_sin: matrix::<L>(origin.matrix() * skew),
        turn_cos: matrix::<L>(origin.matrix() * (skew * skew)),
        products: products.collect(),
        row: rows[dof].start,
    }
}

/// `None` for a link that nothing moves.
fn contact_body<L: Lane>(
    robot: &Robot,
    tree: &Tree,
    rows: &[Row],
    link: usize,
    first_point: usize,
) -> Option<ContactBody<L>> {
    let moving = &tree.moving[link];
    let last = moving.iter().map(|&(d, _)| d).max().or(tree.root.checked_sub(1))?;
    let path: Vec<_> = rows[last].ancestors.iter().copied().chain([last]).collect();
    let subspaces = path
        .iter()
        .map(|d| moving.iter().find(|(e, _)| e == d).map(|&(_, s)| s))
        .collect();
    let points = &robot.links[link].contact_points;
    let centre = points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64;
    Some(ContactBody {
        link,
        path,
        subspaces,
        centre: scalars::<L>(centre),
        points: points.iter().map(|p| scalars::<L>(p.coords)).collect(),
        first_point,
    })
}

fn scalars<L: Lane>(v: Vector3<f64>) -> [L::Scalar; 3] {
    [L::scalar(v.x), L::scalar(v.y), L::scalar(v.z)]
}

fn matrix<L: Lane>(m: Matrix3<f64>) -> [[L::Scalar; 3]; 3] {
    [0, 1, 2].map(|row| scalars::<L>(m.row(row).transpose()))
}
