//! Reading a URDF into links that form a tree, with the place of each link and joint in the text.
//!
//! urdf-rs reads the values. It knows neither positions nor absence (missing limits become zero), so both come
//! from the text: the n-th `<link>` (`<joint>`) of the text is the n-th link (joint) of urdf-rs.

use std::collections::HashMap;
use std::ops::Range;

use urdf_rs::JointType;

use super::source::{RobotError, Source};
use super::urdf_text::{self, Element};

/// A URDF whose numbers are finite, whose names are unique and whose links form one tree.
pub(super) struct Urdf {
    pub source: Source,
    pub robot: urdf_rs::Robot,
    /// Position limits of each joint, where the text gives both.
    pub limits: Vec<Option<(f64, f64)>>,
    /// Index of the link that no joint carries.
    pub root: usize,
    /// Indices of the parent and the child link of each joint.
    pub ends: Vec<(usize, usize)>,
    index: HashMap<String, usize>,
    link_at: Vec<Range<usize>>,
    joint_at: Vec<Range<usize>>,
}

impl Urdf {
    /// Reads and checks a URDF.
    pub fn new(source: Source) -> Result<Self, RobotError> {
        let document = urdf_text::parse(&source)?;
        let (links, joints) = urdf_text::check(&source, &document)?;
        let robot = urdf_rs::read_from_string(&source.text).map_err(|error| {
            let message = format!("not a URDF: {error}");
            source.error(
                document.root_element().range(),
                message,
                "see the URDF reference for this element",
            )
        })?;
        let own = robot.links.iter().map(|link| &link.name);
        same(&source, &links, own)?;
        same(&source, &joints, robot.joints.iter().map(|joint| &joint.name))?;
        let ends = ends(&source, &links, &joints)?;
        let root = root(&source, &links, &joints, &ends)?;
        let limits = joints.iter().map(limits).collect();
        let index = robot
            .joints
            .iter()
            .enumerate()
            .map(|(i, joint)| (joint.name.clone(), i))
            .collect();
        let ranges = |nodes: &[Element]| nodes.iter().map(Element::range).collect();
        let (link_at, joint_at) = (ranges(&links), ranges(&joints));
        drop((links, joints));
        drop(document);
        let urdf = Self {
            source,
            robot,
            limits,
            root,
            ends,
            index,
            link_at,
            joint_at,
        };
        (0..urdf.robot.joints.len()).try_for_each(|joint| urdf.check_joint(joint))?;
        Ok(urdf)
    }

    /// The file's text.
    pub fn text(&self) -> &str {
        &self.source.text
    }

    /// Index of a joint by name.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.index.get(name).copied()
    }

    /// An error at a joint.
    pub fn joint_error(&self, joint: usize, message: impl Into<String>, help: impl Into<String>) -> RobotError {
        self.source.error(self.joint_at[joint].clone(), message, help)
    }

    /// An error at a link.
    pub fn link_error(&self, link: usize, message: impl Into<String>, help: impl Into<String>) -> RobotError {
        self.source.error(self.link_at[link].clone(), message, help)
    }

    /// Whether a joint turns or slides.
    pub fn moves(&self, joint: usize) -> bool {
        use JointType::{Continuous, Prismatic, Revolute};
        matches!(self.robot.joints[joint].joint_type, Revolute | Continuous | Prismatic)
    }

    /// Checks type, axis, limits, dynamics and mimic of a joint.
    fn check_joint(&self, index: usize) -> Result<(), RobotError> {
        let joint = &self.robot.joints[index];
        let name = &joint.name;
        let error = |message: String, help: &str| Err(self.joint_error(index, message, help));
        match joint.joint_type {
            JointType::Planar | JointType::Spherical => {
                let help = "write a chain of revolute or prismatic joints instead";
                return error(
                    format!("joint `{name}`: planar and spherical joints are not supported"),
                    help,
                );
            }
            JointType::Floating if self.ends[index].0 != self.root || self.root_carries() != 1 => {
                let help =
                    "a floating joint leads from the root link (usually `world`) to the base, and is alone there";
                return error(
                    format!("joint `{name}` floats, but not between the world and the base"),
                    help,
                );
            }
            JointType::Revolute | JointType::Prismatic if self.limits[index].is_none() && joint.mimic.is_none() => {
                let help = "add <limit lower=\"...\" upper=\"...\" effort=\"...\" velocity=\"...\"/>, or make a turning joint `continuous`";
                return error(format!("joint `{name}` has no position limits"), help);
            }
            _ => {}
        }
        if !self.moves(index) {
            return Ok(());
        }
        if joint.axis.xyz.iter().map(|x| x * x).sum::<f64>() < 1e-12 {
            return error(
                format!("joint `{name}` has an axis of zero length"),
                "an axis is a direction such as 0 1 0",
            );
        }
        if let Some((lower, upper)) = self.limits[index].filter(|(lower, upper)| lower > upper) {
            let message = format!("joint `{name}`: lower limit {lower} is above upper limit {upper}");
            return error(message, "the lower limit is the smaller one");
        }
        let dynamics = joint
            .dynamics
            .as_ref()
            .map_or((0.0, 0.0), |dynamics| (dynamics.damping, dynamics.friction));
        if dynamics.0 < 0.0 || dynamics.1 < 0.0 || joint.limit.effort < 0.0 || joint.limit.velocity < 0.0 {
            let message = format!("joint `{name}` has negative damping, friction, effort or velocity");
            return error(message, "these are magnitudes: zero or positive");
        }
        self.check_mimic(index)
    }

    /// Follows the mimic chain of a joint; more steps than joints means that it never ends.
    fn check_mimic(&self, start: usize) -> Result<(), RobotError> {
        let mut at = start;
        for _ in 0..=self.robot.joints.len() {
            let Some(mimic) = &self.robot.joints[at].mimic else {
                return Ok(());
            };
            if mimic.multiplier == Some(0.0) {
                let message = format!(
                    "joint `{}` follows `{}` with a multiplier of 0, which is not at all",
                    self.robot.joints[at].name, mimic.joint
                );
                return Err(self.joint_error(at, message, "give the ratio of the two, or make the joint fixed"));
            }
            let Some(followed) = self.joint(&mimic.joint) else {
                let message = format!(
                    "joint `{}` mimics `{}`, which does not exist",
                    self.robot.joints[at].name, mimic.joint
                );
                return Err(self.joint_error(at, message, "name a joint of this URDF"));
            };
            at = followed;
        }
        let message = format!(
            "joint `{}` mimics itself, directly or through others",
            self.robot.joints[start].name
        );
        Err(self.joint_error(
            start,
            message,
            "a chain of mimic joints ends at a joint that moves by itself",
        ))
    }

    /// Number of joints on the root link.
    fn root_carries(&self) -> usize {
        self.ends.iter().filter(|(parent, _)| *parent == self.root).count()
    }
}

/// Lower and upper limit if the text gives either (the other is zero then, as the URDF reference says). Those of a
/// continuous joint mean nothing.
fn limits(joint: &Element) -> Option<(f64, f64)> {
    if joint.attribute("type") == Some("continuous") {
        return None;
    }
    let limit = joint.children().find(|node| node.has_tag_name("limit"))?;
    let value = |name| limit.attribute(name).map(|text| text.trim().parse().unwrap_or(0.0));
    match (value("lower"), value("upper")) {
        (None, None) => None,
        (lower, upper) => Some((lower.unwrap_or(0.0), upper.unwrap_or(0.0))),
    }
}

/// Refuses a text whose links or joints are not the same to both readers of XML: they end `<?x <?y> ?>` at different places.
fn same<'a>(
    source: &Source,
    elements: &[Element],
    names: impl ExactSizeIterator<Item = &'a String>,
) -> Result<(), RobotError> {
    let count = names.len();
    let mut pairs = elements.iter().zip(names);
    let other = pairs.find(|(element, name)| element.attribute("name") != Some(name));
    match other.map(|(element, _)| element).or(elements.get(count)) {
        None if elements.len() == count => Ok(()),
        element => Err(source.error(
            element.map_or(0..0, Element::range),
            "links and joints are not the same to every reader of XML",
            "take processing instructions (<? ... ?>) out of the file",
        )),
    }
}

/// Indices of parent and child link of each joint; a link may be the child of one joint only.
fn ends(source: &Source, links: &[Element], joints: &[Element]) -> Result<Vec<(usize, usize)>, RobotError> {
    let index: HashMap<_, _> = links
        .iter()
        .enumerate()
        .map(|(i, link)| (link.attribute("name"), i))
        .collect();
    let mut carried_by: HashMap<usize, &str> = HashMap::new();
    let end = |joint: &Element, tag: &str| {
        let node = joint.children().find(|node| node.has_tag_name(tag)).unwrap_or(*joint);
        index.get(&node.attribute("link")).copied().ok_or_else(|| {
            let message = format!(
                "the {tag} link `{}` does not exist",
                node.attribute("link").unwrap_or_default()
            );
            source.error(node.range(), message, "name a <link> of this URDF")
        })
    };
    let mut ends = Vec::with_capacity(joints.len());
    for joint in joints {
        let (parent, child) = (end(joint, "parent")?, end(joint, "child")?);
        let name = joint.attribute("name").unwrap_or_default();
        if let Some(other) = carried_by.insert(child, name) {
            let link = links[child].attribute("name").unwrap_or_default();
            let message = format!("link `{link}` has two parents: joints `{other}` and `{name}` close a loop");
            return Err(source.error(joint.range(), message, "cut the loop; couple its joints with <mimic>"));
        }
        ends.push((parent, child));
    }
    Ok(ends)
}

/// The one link that no joint carries, from which all others must be reached.
fn root(source: &Source, links: &[Element], joints: &[Element], ends: &[(usize, usize)]) -> Result<usize, RobotError> {
    let mut parent = vec![None; links.len()];
    ends.iter()
        .enumerate()
        .for_each(|(joint, &(from, to))| parent[to] = Some((joint, from)));
    let roots: Vec<usize> = (0..links.len()).filter(|&link| parent[link].is_none()).collect();
    if let [_, second, ..] = roots[..] {
        let name = |link: usize| links[link].attribute("name").unwrap_or_default();
        let message = format!("links `{}` and `{}` are not connected", name(roots[0]), name(second));
        return Err(source.error(
            links[second].range(),
            message,
            "a robot is one tree: join every link but one to a parent",
        ));
    }
    for start in 0..links.len() {
        let (mut at, mut steps) = (start, 0);
        while let Some((joint, from)) = parent[at] {
            (at, steps) = (from, steps + 1);
            if steps > links.len() {
                let message = format!(
                    "joint `{}` closes a loop",
                    joints[joint].attribute("name").unwrap_or_default()
                );
                return Err(source.error(
                    joints[joint].range(),
                    message,
                    "links form a tree; couple the joints of a loop with <mimic>",
                ));
            }
        }
    }
    Ok(roots[0])
}
