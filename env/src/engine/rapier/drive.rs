//! One joint's drive over one step: implicit where it is not saturated, constant where it is.
//!
//! rapier integrates a joint spring `stiffness (rest - q)` and a damper implicitly, inside the mass matrix, which is
//! stable at any gain but has no torque limit; its motors have a limit but are solved by a few sweeps of
//! Gauss-Seidel that start cold and sag under load. So the spring is used, and a saturated joint gets a constant
//! torque instead. Which it is follows from the torque the implicit step would end with,
//!
//! `torque = torque0 - D dv`,  `dv = dt (torque0 + load - c v) / (M + dt (D + c))`,  `D = damping + dt stiffness`,
//!
//! with `torque0` the drive's torque were the velocity to stay, M the joint's effective inertia, c its
//! viscous friction and `load` what everything else did to the joint in the last step. With the true
//! inertia and load of a single joint this is the exact solution of the clamped implicit step; elsewhere a wrong
//! guess changes the torque of one step by `D` times the error in dv.

use serde::{Deserialize, Serialize};

/// Stiffness that stands for none: a spring so soft and so far stretched is a constant torque, to rounding.
const SOFT: f64 = 1e-9;

/// The drive's parameters for one joint and step, see [`crate::engine::Drive`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Command {
    pub target: f64,
    pub stiffness: f64,
    pub damping: f64,
    pub feed_forward: f64,
    pub torque_min: f64,
    pub torque_max: f64,
}

/// What a joint remembers from step to step.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(super) struct Memory {
    /// Effective inertia at the start of the episode, kg m^2 or kg.
    pub inertia: f64,
    /// Viscous friction, N m s/rad or N s/m.
    pub viscous: f64,
    /// Torque of gravity, contacts and other joints in the last step, N m or N.
    pub load: f64,
}

/// A spring and damper for rapier's implicit integration, and the torque they amount to.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Applied {
    /// Spring stiffness, its rest position, and damping with the viscous friction.
    pub stiffness: f64,
    pub rest: f64,
    pub damping: f64,
    /// The drive's torque is `torque - resistance (velocity after - velocity before)`.
    torque: f64,
    resistance: f64,
}

impl Applied {
    /// What to apply to a joint at `position` moving with `velocity`.
    pub(super) fn new(command: &Command, memory: &Memory, position: f64, velocity: f64, dt: f64) -> Self {
        let Command {
            target,
            stiffness,
            damping,
            feed_forward,
            ..
        } = *command;
        let resistance = damping + dt * stiffness;
        let torque = stiffness * (target - position) - resistance * velocity + feed_forward;
        let accelerating = torque + memory.load - memory.viscous * velocity;
        let change = dt * accelerating / (memory.inertia + dt * (resistance + memory.viscous));
        let implicit = torque - resistance * change;
        if !implicit.is_finite() {
            return Self {
                torque: f64::NAN,
                ..Self::default()
            };
        }
        let limited = implicit.min(command.torque_max).max(command.torque_min);
        if limited == implicit && stiffness >= SOFT {
            Self {
                stiffness,
                rest: target + feed_forward / stiffness,
                damping: damping + memory.viscous,
                torque,
                resistance,
            }
        } else if limited == implicit {
            Self {
                stiffness: SOFT,
                rest: position + feed_forward / SOFT,
                damping: damping + memory.viscous,
                torque,
                resistance,
            }
        } else {
            Self {
                stiffness: SOFT,
                rest: position + limited / SOFT,
                damping: memory.viscous,
                torque: limited,
                resistance: 0.0,
            }
        }
    }

    /// The drive's torque over a step that took the joint's velocity from `before` to `after`.
    pub(super) fn torque(&self, before: f64, after: f64) -> f64 {
        self.torque - self.resistance * (after - before)
    }

    /// Whether all of it can be given to the engine.
    pub(super) fn is_finite(&self) -> bool {
        (self.stiffness + self.rest + self.damping + self.torque).is_finite()
    }
}

impl Memory {
    /// Notes the load of a step that took the joint from velocity `before` to `after` under the drive's `torque`.
    pub(super) fn observe(&mut self, before: f64, after: f64, torque: f64, dt: f64) {
        self.load = self.inertia * (after - before) / dt - torque + self.viscous * after;
    }
}
