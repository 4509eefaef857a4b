//! A world as bytes: postcard of rapier's own state and of the episode's parameters, behind a short header.

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use super::contact::{GroundForce, Stick};
use super::drive::Memory;
use super::inertia::Turning;
use super::lane::{JointNow, Lane};
use super::scene::{Scene, State};
use crate::engine::Friction;

/// First bytes of a saved world; the digit counts changes of the format.
const MAGIC: &[u8; 12] = b"omni.rapier2";

#[derive(Serialize, Deserialize)]
struct Episode {
    robot: String,
    gravity: Vector3<f64>,
    friction: Friction,
    push: Vector3<f64>,
    base_offset: Isometry3<f64>,
    memory: Vec<Memory>,
    joints: Vec<JointNow>,
    forces: Vec<GroundForce>,
    sticks: Vec<Stick>,
    inertias: Vec<Turning>,
    alive: bool,
}

pub(super) fn save(lane: &Lane, scene: &Scene, bytes: &mut Vec<u8>) {
    let episode = Episode {
        robot: scene.name.clone(),
        gravity: lane.gravity,
        friction: lane.friction,
        push: lane.push,
        base_offset: lane.base_offset,
        memory: lane.memory.clone(),
        joints: lane.joints.clone(),
        forces: lane.forces.clone(),
        sticks: lane.sticks.clone(),
        inertias: lane.inertias.clone(),
        alive: lane.alive,
    };
    let body = postcard::to_stdvec(&(episode, &lane.state)).expect("writing to memory does not fail");
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&(body.len() as u64).to_le_bytes());
    bytes.extend_from_slice(&checksum(&body).to_le_bytes());
    bytes.extend_from_slice(&body);
}

pub(super) fn load(lane: &mut Lane, scene: &Scene, bytes: &[u8]) -> Result<(), String> {
    let body = body(bytes).ok_or("not a world saved by the rapier engine, or a damaged one")?;
    let (episode, state): (Episode, State) = postcard::from_bytes(body)
        .map_err(|e| format!("a world saved by another version of the rapier engine: {e}"))?;
    let same_shape = episode.memory.len() == scene.freedoms.len()
        && episode.joints.len() == scene.freedoms.len()
        && episode.forces.len() == scene.touchers.len()
        && episode.sticks.len() == scene.touchers.len()
        && episode.inertias.len() == scene.touchers.len()
        && state.bodies.len() == scene.bodies.len()
        && state.colliders.len() == scene.template.colliders.len()
        && velocities(&state, scene) == velocities(&scene.template, scene);
    if episode.robot != scene.name || !same_shape {
        return Err(format!(
            "a world of robot {:?}, but this engine simulates {:?}",
            episode.robot, scene.name
        ));
    }
    lane.gravity = episode.gravity;
    lane.friction = episode.friction;
    lane.push = episode.push;
    lane.base_offset = episode.base_offset;
    lane.memory = episode.memory;
    lane.joints = episode.joints;
    lane.forces = episode.forces;
    lane.sticks = episode.sticks;
    lane.inertias = episode.inertias;
    lane.alive = episode.alive;
    lane.restore(state);
    Ok(())
}

fn velocities(state: &State, scene: &Scene) -> Option<usize> {
    let multibody = state.multibodies.get_multibody(scene.multibody)?;
    Some(multibody.ndofs())
}

fn body(bytes: &[u8]) -> Option<&[u8]> {
    let rest = bytes.strip_prefix(MAGIC)?;
    let (length, rest) = rest.split_first_chunk::<8>()?;
    let (sum, rest) = rest.split_first_chunk::<8>()?;
    let body = rest.get(..usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    (checksum(body) == u64::from_le_bytes(*sum)).then_some(body)
}

/// FNV-1a: finds damage, not malice.
fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}
