//! From files to a [`Robot`].

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Point3, Vector3};
use urdf_rs::JointType;

use super::settings::Settings;
use super::source::{RobotError, Source};
use super::tree::{self, Tree};
use super::urdf::Urdf;
use super::{Base, Kinematics, Robot, effects, feet, joints, mirror, ranges};

/// Smallest inertia (kg m^2) or mass (kg) that a degree of freedom may move.
const SMALLEST_INERTIA: f64 = 1e-12;

/// Loads a robot: a folder with one `.urdf` and perhaps a `robot.toml` (or a `.toml` named like the folder or the URDF),
/// or a `.urdf` file with perhaps a `.toml` of the same name, or a `robot.toml`, beside it.
///
/// Meshes are never opened. What had to be assumed is in [`Robot::notes`].
///
/// # Errors
/// A missing or unreadable file, or anything in it that makes no robot, with the place in the file.
pub fn load(path: &Path) -> Result<Robot, RobotError> {
    let (urdf, toml) = files(path)?;
    let urdf = Urdf::new(Source::read(&urdf)?)?;
    let source = match &toml {
        Some(toml) => Source::read(toml)?,
        None => Source {
            file: "(no TOML)".into(),
            text: String::new(),
        },
    };
    let mut robot = build(&urdf, &Settings::new(&source)?, &source)?;
    if toml.is_none() {
        robot
            .notes
            .insert(0, "no TOML beside the URDF: defaults are used".into());
    }
    Ok(robot)
}

/// Loads the robot of the file `urdf` with `toml` for its `robot.toml`.
///
/// # Errors
/// As [`load`].
pub fn load_with(urdf: &Path, toml: &str) -> Result<Robot, RobotError> {
    let source = Source {
        file: "robot.toml".into(),
        text: toml.into(),
    };
    build(&Urdf::new(Source::read(urdf)?)?, &Settings::new(&source)?, &source)
}

/// The files that [`load`] reads: the URDF and, if there is one, the TOML.
///
/// # Errors
/// When `path` is neither a robot's folder nor a URDF.
pub fn files(path: &Path) -> Result<(PathBuf, Option<PathBuf>), RobotError> {
    let file = path.display().to_string();
    let fault = |message: String, help: &str| RobotError::File {
        file: file.clone(),
        message,
        help: help.into(),
    };
    if !path.is_dir() {
        if path.extension().is_none_or(|extension| extension != "urdf") {
            let help = "give a folder with a .urdf and a robot.toml, or a .urdf file";
            let what = if path.exists() {
                "neither a folder nor a .urdf file"
            } else {
                "does not exist"
            };
            return Err(fault(what.into(), help));
        }
        let candidates = [path.with_extension("toml"), path.with_file_name("robot.toml")];
        return Ok((path.into(), candidates.into_iter().find(|file| file.exists())));
    }
    let entries =
        std::fs::read_dir(path).map_err(|error| fault(error.to_string(), "give a folder that can be read"))?;
    let is_urdf = |file: &PathBuf| file.extension().is_some_and(|extension| extension == "urdf");
    let mut urdfs: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(is_urdf).collect();
    urdfs.sort();
    let [urdf] = &urdfs[..] else {
        return Err(fault(
            format!("holds {} .urdf files", urdfs.len()),
            "a robot folder holds exactly one",
        ));
    };
    let named = path.file_name().map(|name| path.join(name).with_extension("toml"));
    let toml = [Some(path.join("robot.toml")), named, Some(urdf.with_extension("toml"))]
        .into_iter()
        .flatten()
        .find(|file| file.exists());
    Ok((urdf.clone(), toml))
}

/// Names of the joints of the URDF `urdf`, taken by itself, that move neither mass nor inertia. [`load`] takes no such robot, unless
/// they are `locked`.
///
/// # Errors
/// As [`load`], for anything else.
pub fn massless_joints(urdf: &Path) -> Result<Vec<String>, RobotError> {
    let source = Source {
        file: "robot.toml".into(),
        text: String::new(),
    };
    let (robot, _) = assemble(&Urdf::new(Source::read(urdf)?)?, &Settings::new(&source)?, &source)?;
    let names = massless(&robot).into_iter().map(|dof| robot.dof(dof).name.clone());
    Ok(names.collect())
}

/// Links and joints as they are in the files, whether or not they make a robot that moves.
fn assemble(urdf: &Urdf, settings: &Settings, source: &Source) -> Result<(Robot, Tree), RobotError> {
    let held = joints::held(urdf, settings, source)?;
    let (root, _, base_pose) = base(urdf);
    let mut tree = Tree::new(urdf, root, &held)?;
    tree.note_shapeless(urdf);
    let mut notes = std::mem::take(&mut tree.notes);
    let (joints, dofs) = joints::build(urdf, &tree, settings, source, &mut notes)?;
    let policy = joints::policy(&joints, &dofs, settings, source, urdf, &mut notes)?;
    let feet = feet::from_settings(settings, source, urdf, &tree)?;
    let overlap_pairs = overlap_pairs(urdf, settings, source, &tree)?;
    let name = urdf.robot.name.clone();
    let base = Base::Fixed;
    let mut links = std::mem::take(&mut tree.links);
    for contact in &settings.contact {
        let (link, frame) = feet::find_link(&contact.link, source, urdf, &tree)?;
        links[link].contact_points.extend(
            contact
                .points
                .get_ref()
                .iter()
                .map(|&point| frame * Point3::from(point)),
        );
    }
    let mirror = None;
    let robot = Robot {
        name,
        base,
        base_pose,
        links,
        joints,
        dofs,
        policy,
        feet,
        mirror,
        overlap_pairs,
        urdf: urdf.text().to_owned(),
        effects: Vec::new(),
        ranges: Vec::new(),
        notes,
    };
    Ok((robot, tree))
}

fn build(urdf: &Urdf, settings: &Settings, source: &Source) -> Result<Robot, RobotError> {
    let (mut robot, tree) = assemble(urdf, settings, source)?;
    check_masses(&robot, urdf, &tree)?;
    let (root, given_base, _) = base(urdf);
    if settings.foot.is_empty() && given_base != Some(Base::Fixed) {
        robot.feet = feet::guess(&robot);
        let names: Vec<&str> = robot.feet.iter().map(|foot| foot.name.as_str()).collect();
        let found = if names.is_empty() {
            "none found".into()
        } else {
            names.join(", ")
        };
        robot
            .notes
            .push(format!("feet, guessed from the lowest shapes: {found}"));
    }
    for foot in &robot.feet {
        let link = &mut robot.links[foot.link];
        link.contact_points.extend(foot.corners());
        if link.shapes.is_empty() {
            link.shapes.push(foot.slab());
            let note = format!("foot `{}` has no collision shape: its sole is one", foot.name);
            robot.notes.push(note);
        }
    }
    set_base(&mut robot, settings.base.map(Base::from).or(given_base));
    feet::check(&robot, settings, source)?;
    if robot.base == Base::Floating && !matches!(robot.feet.len(), 0 | 2) {
        let n = robot.feet.len();
        robot.notes.push(format!(
            "feet: {n}, and none of the reward's foot term, which is for two"
        ));
    }
    if robot.base == Base::Floating && robot.feet.len() > 1 && robot.overlap_pairs.is_empty() {
        let note = "no overlap_pairs: legs may pass through each other, as they collide with the ground only";
        robot.notes.push(note.into());
    }
    if robot.base == Base::Floating && robot.links[0].inertial.mass == 0.0 {
        let message = format!("the floating base link `{}` has no mass", robot.links[0].name);
        return Err(urdf.link_error(root, message, "give it an <inertial>, or set base = \"fixed\""));
    }
    for d in 0..robot.dofs.len() {
        let (lower, upper) = robot.limits(d);
        if lower > upper {
            let name = &robot.dof(d).name;
            let message = format!("joint `{name}` has no position that is within the limits of all that follow it too");
            return Err(urdf.joint_error(
                tree.joints[robot.dofs[d]].urdf,
                message,
                "mend the limits, the multiplier or the offset",
            ));
        }
    }
    effects::add(&mut robot, settings, source)?;
    ranges::add(&mut robot, settings, source)?;
    if let Some(words) = &settings.mirror {
        robot.mirror = Some(mirror::map(&robot, words, source)?);
    }
    Ok(robot)
}

/// The links that must not overlap.
fn overlap_pairs(
    urdf: &Urdf,
    settings: &Settings,
    source: &Source,
    tree: &Tree,
) -> Result<Vec<(usize, usize)>, RobotError> {
    let pair = |names: &[toml::Spanned<String>; 2]| {
        let link = |name| feet::find_link(name, source, urdf, tree).map(|(link, _)| link);
        let (one, other) = (link(&names[0])?, link(&names[1])?);
        if one == other {
            return Err(source.error(
                names[1].span(),
                format!(
                    "`{}` and `{}` are one rigid body, which always overlaps with itself",
                    names[0].get_ref(),
                    names[1].get_ref()
                ),
                "name two links with a joint between them that moves",
            ));
        }
        Ok((one, other))
    };
    settings.overlap_pairs.iter().map(pair).collect()
}

/// The base link, and what the URDF says about how it is held: a floating joint from the root makes it float, a
/// fixed joint from a massless `world` bolts it down.
fn base(urdf: &Urdf) -> (usize, Option<Base>, Isometry3<f64>) {
    let mut carried = (0..urdf.ends.len()).filter(|&joint| urdf.ends[joint].0 == urdf.root);
    let (Some(joint), None) = (carried.next(), carried.next()) else {
        return (urdf.root, None, Isometry3::identity());
    };
    let root = &urdf.robot.links[urdf.root];
    let child = urdf.ends[joint].1;
    match urdf.robot.joints[joint].joint_type {
        JointType::Floating => (child, Some(Base::Floating), Isometry3::identity()),
        JointType::Fixed if root.name == "world" && root.inertial.mass.value == 0.0 => (
            child,
            Some(Base::Fixed),
            tree::isometry(&urdf.robot.joints[joint].origin),
        ),
        _ => (urdf.root, None, Isometry3::identity()),
    }
}

/// Decides how the base is held, and lifts a floating one so that its lowest contact point touches the ground.
fn set_base(robot: &mut Robot, given: Option<Base>) {
    robot.base = given.unwrap_or_else(|| {
        let (base, why) = match robot.feet.len() {
            0 => (Base::Fixed, "fixed, as the robot has no feet"),
            _ => (Base::Floating, "floating, as the robot has feet"),
        };
        robot.notes.push(format!("base: {why}"));
        base
    });
    if robot.base == Base::Fixed {
        return;
    }
    robot.base_pose = Isometry3::identity();
    let kinematics = Kinematics::new(robot);
    let lowest = |points: &dyn Fn(usize) -> Vec<Point3<f64>>| {
        let heights = (0..robot.links.len())
            .flat_map(|link| points(link).into_iter().map(move |point| (link, point)))
            .map(|(link, point)| (kinematics.pose(link) * point).z);
        heights.fold(f64::INFINITY, f64::min)
    };
    let contact = lowest(&|link| robot.links[link].contact_points.clone());
    let shape = lowest(&|link| {
        let down = kinematics.pose(link).rotation.inverse() * -Vector3::z();
        robot.links[link]
            .shapes
            .iter()
            .flat_map(|shape| shape.low_points(&down))
            .collect()
    });
    let height = [contact, shape].into_iter().find(|height| height.is_finite());
    robot.base_pose.translation.z = -height.unwrap_or(0.0);
}

/// Every degree of freedom must move mass: otherwise its acceleration is undefined.
fn check_masses(robot: &Robot, urdf: &Urdf, tree: &Tree) -> Result<(), RobotError> {
    let massless = massless(robot);
    let Some(&first) = massless.first() else { return Ok(()) };
    let joint = &tree.joints[robot.dofs[first]];
    let names: Vec<String> = massless
        .iter()
        .map(|&dof| format!("\"{}\"", robot.dof(dof).name))
        .collect();
    let others = match names.len() {
        1 => String::new(),
        n => format!(", nor do {} others", n - 1),
    };
    let message = format!("joint `{}` moves no mass or inertia{others}", robot.dof(first).name);
    let help = format!(
        "give the links it moves an <inertial>, make it fixed or a mimic, or hold it in robot.toml: locked = [{}]",
        names.join(", ")
    );
    Err(urdf.joint_error(joint.urdf, message, help))
}

/// Degrees of freedom that move neither mass nor inertia.
fn massless(robot: &Robot) -> Vec<usize> {
    let mut kinematics = Kinematics::new(robot);
    (0..robot.dofs.len())
        .filter(|&dof| kinematics.moved_inertia(robot, dof) < SMALLEST_INERTIA)
        .collect()
}
