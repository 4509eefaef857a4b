//! The effects of one joint in one world, run once a physics step between target and engine.

use super::command::Command;
use super::friction::Friction;
use super::outside::Outside;
use super::sensor::Sensor;
use super::transmission::{Rotor, Servo, Transmission};
use super::{Effect, Kind, Table, Variable};
use crate::robot::Joint;

/// What the effects of a joint are.
#[derive(Clone, Debug)]
pub(crate) struct Model {
    dt: f64,
    armature: f64,
    command: Command,
    friction: Friction,
    transmission: Transmission,
    sensor: Sensor,
    outside: Outside,
    table: Option<Table>,
    /// Voltage at the motor over the one its data are for.
    supply: f64,
}

/// What the effects of a joint remember from step to step.
#[derive(Clone, Debug)]
pub(crate) struct Memory {
    targets: Delay,
    readings: Delay,
    /// The rate limiter's target.
    followed: f64,
    /// Velocity at the last step.
    velocity: f64,
    /// How far what rubs gives way, -1 to 1.
    bent: f64,
    rotor: Rotor,
    /// The motor's torque in the last step.
    motor: f64,
    /// What [`Model::step`] added to the engine's clamp.
    shift: f64,
    /// Since the start of the log or episode, s.
    time: f64,
}

/// A joint's entries in [`crate::engine::Drive`].
pub(crate) struct JointDrive<'a> {
    pub target: &'a mut f64,
    pub stiffness: &'a mut f64,
    pub damping: &'a mut f64,
    pub feed_forward: &'a mut f64,
    pub torque_min: &'a mut f64,
    pub torque_max: &'a mut f64,
    pub friction: &'a mut f64,
}

/// What the servo was told.
pub(crate) struct Told {
    /// Position target as commanded, rad or m.
    pub target: f64,
    /// The servo's gains; zero where a torque is commanded.
    pub stiffness: f64,
    pub damping: f64,
    /// Commanded torque, N m or N.
    pub torque: f64,
    /// Whether a torque is commanded instead of a position.
    pub effort: bool,
}

impl Model {
    /// The effects `effects` on `joint`, which moves `inertia` beside its armature. `None` where there are none.
    pub fn new<'a>(joint: &Joint, inertia: f64, dt: f64, effects: impl Iterator<Item = &'a Effect>) -> Option<Self> {
        let mut model = Self {
            dt,
            armature: joint.passive.armature,
            command: Command::default(),
            friction: Friction {
                coulomb: joint.passive.friction,
                ..Friction::default()
            },
            transmission: Transmission::default(),
            sensor: Sensor::default(),
            outside: Outside::default(),
            table: None,
            supply: 1.0,
        };
        let mut any = false;
        for effect in effects {
            any = true;
            model.add(effect);
        }
        if model.transmission.is_split() {
            model.transmission.couple(joint.passive.armature, inertia, dt);
        }
        any.then_some(model)
    }

    fn add(&mut self, effect: &Effect) {
        let v = &effect.values;
        match effect.kind {
            Kind::CommandDelay => self.command.delay = v[0] / self.dt,
            Kind::CommandRateLimit => self.command.rate = v[0] * self.dt,
            Kind::CommandDeadBand => self.command.dead_band = v[0],
            Kind::CommandGain => self.command.gain = v[0],
            Kind::CommandQuantisation => self.command.quantum = v[0],
            Kind::SupplyVoltage => self.supply = v[0] / v[1],
            Kind::StribeckFriction => {
                (self.friction.stribeck, self.friction.stribeck_velocity) = (v[0], v[1]);
                self.friction.travel = v[2];
            }
            Kind::LoadDependentFriction => {
                (self.friction.load, self.friction.load_growth) = (v[0], v[1]);
                (self.friction.load_at_rest, self.friction.load_velocity) = (v[2], v[3]);
            }
            Kind::DirectionalFriction => {
                (self.friction.more_forward, self.friction.more_damped_forward) = (v[0], v[1]);
            }
            Kind::Backlash => {
                (self.transmission.gap, self.transmission.motor_encoder) = (v[0], v[1] > 0.5);
                self.transmission.gap_damping_ratio = v[2];
            }
            Kind::Elasticity => {
                (self.transmission.compliance, self.transmission.motor_encoder) = (v[0], v[1] > 0.5);
                self.transmission.spring_damping_ratio = v[2];
            }
            Kind::PositionRipple => {
                (self.outside.sine, self.outside.cosine, self.outside.frequency) = (v[0], v[1], v[2]);
            }
            Kind::SensorOffset => self.sensor.offset = v[0],
            Kind::SensorScale => self.sensor.scale = v[0],
            Kind::SensorDelay => self.sensor.delay = v[0] / self.dt,
            Kind::ExternalForce => self.outside.constant = v[0],
            Kind::ResidualTorque => self.table.clone_from(&effect.table),
            Kind::TorqueLimit
            | Kind::SpeedTorqueCurve
            | Kind::CoulombFriction
            | Kind::ViscousFriction
            | Kind::Armature
            | Kind::Mass
            | Kind::CentreOfMass
            | Kind::Payload => {}
        }
    }

    /// Memory for a joint at `position` with `velocity` whose command has been `input`, which drives it towards the sign of
    /// `ahead`.
    pub fn memory(&self, (position, velocity): (f64, f64), input: f64, ahead: f64) -> Memory {
        let followed = self.command.rounded(input);
        Memory {
            targets: Delay::new(self.command.delay, followed),
            readings: Delay::new(self.sensor.delay, self.sensor.read(position)),
            followed,
            velocity,
            bent: 1.0_f64.copysign(velocity),
            rotor: self.transmission.rotor(position, velocity, ahead),
            motor: 0.0,
            shift: 0.0,
            time: 0.0,
        }
    }

    /// Fills a memory whose joint was started with what was before: `past(age)` gives command and position `age` steps before
    /// the first step, `known` steps back at most.
    pub fn recall(&self, memory: &mut Memory, known: usize, past: impl Fn(usize) -> (f64, f64)) {
        // The next command is pushed before it is looked at, the reading of the start was pushed already.
        for (i, target) in memory.targets.by_age().enumerate() {
            *target = self.command.rounded(past((i + 1).min(known)).0);
        }
        for (age, reading) in memory.readings.by_age().enumerate().skip(1) {
            *reading = self.sensor.read(past(age.min(known)).1);
        }
        memory.followed = if self.command.rate.is_finite() {
            self.followed(known, past)
        } else {
            memory.targets.arrived()
        };
    }

    /// Where the rate limiter's target is before the first step: `known` steps earlier it was where the joint was.
    fn followed(&self, known: usize, past: impl Fn(usize) -> (f64, f64)) -> f64 {
        let command = |age: usize| self.command.rounded(past(age.min(known)).0);
        let whole = self.command.delay as usize;
        let share = self.command.delay - whole as f64;
        let mut followed = self.sensor.read(past(known).1) / self.command.gain;
        for age in (1..=known).rev() {
            let (younger, older) = (command(age + whole), command(age + whole + 1));
            self.command.follow(younger + share * (older - younger), &mut followed);
        }
        followed
    }

    /// The drive of the next step of a joint at `position` with `velocity`, under what the servo was `told` and the torque
    /// `outside`; `torque` is the engine's drive torque of the last step.
    pub fn step(
        &self,
        memory: &mut Memory,
        drive: &mut JointDrive<'_>,
        told: &Told,
        outside: f64,
        (position, velocity, torque): (f64, f64, f64),
    ) {
        let own = torque - memory.shift;
        if !self.transmission.is_split() {
            memory.motor = own;
        }
        let input = if told.effort { told.torque } else { told.target };
        memory.targets.push(self.command.rounded(input));
        let followed = self.command.follow(memory.targets.arrived(), &mut memory.followed);
        let (asked, effort) = if told.effort {
            (told.target, followed)
        } else {
            (self.sensor.position(followed), 0.0)
        };
        let at_motor = if self.transmission.is_split() && self.transmission.motor_encoder {
            memory.rotor.position
        } else {
            position
        };
        let target = self.command.beyond_dead_band(asked, at_motor);
        let (low, high) = (self.supply * *drive.torque_min, self.supply * *drive.torque_max);
        let stiffness = told.stiffness * self.sensor.scale * self.supply;
        let transmitted = if self.transmission.is_split() {
            // What turns the rotor never came to the joint.
            own
        } else {
            own - self.armature * (velocity - memory.velocity) / self.dt
        };
        let (rubs, pulls) = self.table.as_ref().map_or((0.0, 0.0), |table| {
            let value = table.torque(|variable| match variable {
                Variable::Position => position,
                Variable::Velocity => velocity,
                Variable::Target => asked,
                Variable::Torque => memory.motor,
                Variable::Time => memory.time,
            });
            if table.friction { (value, 0.0) } else { (0.0, value) }
        });
        let built = self.friction.built(&mut memory.bent, velocity * self.dt);
        let dry = (self.friction.bound(velocity, transmitted) + rubs).max(0.0);
        let (bound, one_sided) = self.friction.sides(built * dry);
        *drive.friction = bound;
        let extra = one_sided + self.friction.torque(velocity) + self.outside.torque(position) + pulls + outside;
        memory.velocity = velocity;
        memory.time += self.dt;
        if self.transmission.is_split() {
            let servo = Servo {
                target,
                stiffness,
                damping: told.damping,
                feed_forward: effort,
                torque_min: low,
                torque_max: high,
            };
            let coupling = self
                .transmission
                .begin(&mut memory.rotor, &servo, position, velocity, self.dt);
            (*drive.target, *drive.stiffness, *drive.damping) = (target, 0.0, coupling.damping);
            *drive.feed_forward = coupling.feed_forward + extra;
            (*drive.torque_min, *drive.torque_max) = (coupling.torque_min + extra, coupling.torque_max + extra);
        } else {
            (*drive.target, *drive.stiffness, *drive.damping) = (target, stiffness, told.damping);
            *drive.feed_forward = effort + extra;
            (*drive.torque_min, *drive.torque_max) = (low + extra, high + extra);
        }
        memory.shift = extra;
    }

    /// Ends a physics step of a joint that is now at `position` with `velocity` and got `torque` from the engine's drive: what its encoder
    /// says.
    pub fn finish(&self, memory: &mut Memory, (position, velocity, torque): (f64, f64, f64)) -> f64 {
        if self.transmission.is_split() {
            let own = torque - memory.shift;
            memory.motor = self.transmission.end(&mut memory.rotor, own, velocity, self.dt);
        }
        self.read(memory, position)
    }

    /// Reads the encoder of the joint at `position`.
    pub fn read(&self, memory: &mut Memory, position: f64) -> f64 {
        let behind = self.transmission.is_split() && self.transmission.motor_encoder;
        let seen = if behind { memory.rotor.position } else { position };
        memory.readings.push(self.sensor.read(seen));
        self.delayed_reading(memory)
    }

    /// The last reading that arrived.
    pub fn delayed_reading(&self, memory: &Memory) -> f64 {
        memory.readings.arrived()
    }

    /// Speed without load over the nominal one.
    pub fn supply(&self) -> f64 {
        self.supply
    }
}

impl Memory {
    /// Position and velocity of the rotor where it is a body of its own, else of the joint when it started; rad or m, rad/s or
    /// m/s.
    pub fn state(&self) -> (f64, f64) {
        (self.rotor.position, self.rotor.velocity)
    }

    /// Time since the start of the log or episode, s.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Sets the time since the start of the log or episode, s.
    pub fn set_time(&mut self, time: f64) {
        self.time = time;
    }

    /// The motor's torque in the last step, N m or N.
    pub fn motor_torque(&self) -> f64 {
        self.motor
    }

    /// All numbers in a fixed order, for saving.
    pub fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        let Self {
            targets,
            readings,
            followed,
            velocity,
            bent,
            rotor,
            motor,
            shift,
            time,
        } = self;
        [
            followed,
            velocity,
            bent,
            &mut rotor.position,
            &mut rotor.velocity,
            &mut rotor.motor.torque,
            &mut rotor.motor.by_rotor,
            &mut rotor.motor.by_joint,
            motor,
            shift,
            time,
        ]
        .into_iter()
        .chain(targets.by_age())
        .chain(readings.by_age())
    }
}

/// What is late, and by how much.
#[derive(Clone, Debug)]
struct Delay {
    values: Vec<f64>,
    newest: usize,
    /// Steps, and the share of another.
    whole: usize,
    share: f64,
}

impl Delay {
    /// By `steps`, at a value that has been there for long.
    fn new(steps: f64, value: f64) -> Self {
        let whole = steps as usize;
        Self {
            values: vec![value; steps.ceil() as usize + 2],
            newest: 0,
            whole,
            share: steps - whole as f64,
        }
    }

    /// Takes the next value.
    fn push(&mut self, value: f64) {
        // Most delays are none.
        if self.values.len() > 2 {
            self.newest = self.newest.checked_sub(1).unwrap_or(self.values.len() - 1);
        }
        self.values[self.newest] = value;
    }

    /// The value that has arrived, linear between steps.
    fn arrived(&self) -> f64 {
        if self.values.len() == 2 {
            return self.values[self.newest];
        }
        let (younger, older) = (self.aged(self.whole), self.aged(self.whole + 1));
        younger + self.share * (older - younger)
    }

    fn aged(&self, age: usize) -> f64 {
        let place = self.newest + age;
        let length = self.values.len();
        self.values[if place < length { place } else { place - length }]
    }

    /// The newest first.
    fn by_age(&mut self) -> std::slice::IterMut<'_, f64> {
        self.values.rotate_left(self.newest);
        self.newest = 0;
        self.values.iter_mut()
    }
}
