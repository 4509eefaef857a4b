//! The list of effects: names, parameters, bounds, and what they are.

/// Where an effect sits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Site {
    /// A degree of freedom.
    Joint,
    /// A link.
    Link,
}

/// Where an effect's value stands in a robot's TOML.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A key of a `[[joint]]` entry.
    Joint(&'static str),
    /// An `[[effect]]` table of its own.
    Table,
}

/// What a parameter is measured in: the unit for turning and sliding joints, and what a typical value is a multiple of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// A pure number.
    One,
    /// s.
    Time,
    /// rad or m; typical: the range of motion.
    Position,
    /// rad/s or m/s; typical: the fastest motion.
    Speed,
    /// N m or N; typical: the largest torque of the motion.
    Torque,
    /// 1/(N m) or 1/N; typical: one over the largest torque of the motion.
    PerTorque,
    /// N m s/rad or N s/m; typical: torque over speed.
    Damping,
    /// rad/(N m) or m/N; typical: range over torque.
    Compliance,
    /// kg m^2 or kg; typical: the inertia the joint moves.
    Inertia,
    /// kg; typical: the link's mass.
    Mass,
    /// m; typical: the link's size.
    Length,
    /// Cycles per rad or m.
    Frequency,
    /// V.
    Voltage,
}

impl Scale {
    /// The unit, for a turning or a sliding joint.
    pub fn unit(self, sliding: bool) -> &'static str {
        match (self, sliding) {
            (Self::One, _) => "1",
            (Self::Time, _) => "s",
            (Self::Position, false) => "rad",
            (Self::Position, true) | (Self::Length, _) => "m",
            (Self::Speed, false) => "rad/s",
            (Self::Speed, true) => "m/s",
            (Self::Torque, false) => "N m",
            (Self::Torque, true) => "N",
            (Self::PerTorque, false) => "1/(N m)",
            (Self::PerTorque, true) => "1/N",
            (Self::Damping, false) => "N m s/rad",
            (Self::Damping, true) => "N s/m",
            (Self::Compliance, false) => "rad/(N m)",
            (Self::Compliance, true) => "m/N",
            (Self::Inertia, false) => "kg m^2",
            (Self::Inertia, true) | (Self::Mass, _) => "kg",
            (Self::Frequency, false) => "cycles/rad",
            (Self::Frequency, true) => "cycles/m",
            (Self::Voltage, _) => "V",
        }
    }
}

/// Values that make sense, SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest.
    pub lower: f64,
    /// Largest.
    pub upper: f64,
}

/// A parameter of an effect.
#[derive(Debug, PartialEq)]
pub struct Parameter {
    /// Its key.
    pub name: &'static str,
    /// What it is measured in.
    pub scale: Scale,
    /// The value at which the effect does nothing, where there is one.
    pub neutral: Option<f64>,
    /// Values from which a fit starts, in multiples of what is typical; the physical prior. Empty: it is not fitted.
    pub starts: &'static [f64],
    /// Values a robot may have.
    pub bounds: Bounds,
    /// Value where the TOML gives none; `None`: it must be given.
    pub default: Option<f64>,
    /// What it is.
    pub what: &'static str,
}

/// An effect of the catalogue.
#[derive(Debug, PartialEq)]
pub struct Info {
    /// Its name in files and reports.
    pub id: &'static str,
    /// Where it sits.
    pub site: Site,
    /// Where its value stands.
    pub place: Place,
    /// Its parameters.
    pub parameters: &'static [Parameter],
    /// What it does.
    pub what: &'static str,
}

macro_rules! kinds {
    ($($(#[$doc:meta])* $kind:ident = $info:expr;)*) => {
        /// The models.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        pub enum Kind {
            $($(#[$doc])* $kind,)*
        }

        impl Kind {
            /// Every model.
            pub const ALL: &[Self] = &[$(Self::$kind,)*];

            /// What the catalogue says of it.
            pub fn info(self) -> &'static Info {
                match self {
                    $(Self::$kind => &$info,)*
                }
            }
        }
    };
}

kinds! {
    /// Commands act later.
    CommandDelay = super::command::DELAY;
    /// Targets move no faster than a speed.
    CommandRateLimit = super::command::RATE_LIMIT;
    /// Small position errors make no torque.
    CommandDeadBand = super::command::DEAD_BAND;
    /// Targets are multiplied.
    CommandGain = super::command::GAIN;
    /// Targets are rounded.
    CommandQuantisation = super::command::QUANTISATION;
    /// Largest torque at standstill.
    TorqueLimit = super::drive::TORQUE_LIMIT;
    /// Speed without torque.
    SpeedTorqueCurve = super::drive::SPEED_TORQUE_CURVE;
    /// A supply other than the one the motor's data are for.
    SupplyVoltage = super::drive::SUPPLY_VOLTAGE;
    /// Dry friction.
    CoulombFriction = super::friction::COULOMB;
    /// Friction that grows with speed.
    ViscousFriction = super::friction::VISCOUS;
    /// More friction at rest than in motion.
    StribeckFriction = super::friction::STRIBECK;
    /// Friction that grows with the transmitted torque.
    LoadDependentFriction = super::friction::LOAD;
    /// Friction that differs between the directions.
    DirectionalFriction = super::friction::DIRECTIONAL;
    /// Play between motor and joint.
    Backlash = super::transmission::BACKLASH;
    /// Reflected inertia of the rotor.
    Armature = super::drive::ARMATURE;
    /// Torque that repeats over position.
    PositionRipple = super::outside::RIPPLE;
    /// A spring between motor and joint.
    Elasticity = super::transmission::ELASTICITY;
    /// A link's mass and inertia.
    Mass = super::body::MASS;
    /// A link's centre of mass.
    CentreOfMass = super::body::CENTRE_OF_MASS;
    /// A point mass on a link.
    Payload = super::body::PAYLOAD;
    /// The encoder's zero.
    SensorOffset = super::sensor::OFFSET;
    /// The encoder's scale.
    SensorScale = super::sensor::SCALE;
    /// Readings arrive later.
    SensorDelay = super::sensor::DELAY;
    /// A constant torque.
    ExternalForce = super::outside::CONSTANT;
    /// A measured table of torque.
    ResidualTorque = super::table::RESIDUAL;
}

impl Kind {
    /// The kind with the name `id`.
    pub fn named(id: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|kind| kind.info().id == id)
    }

    /// Its name in files and reports.
    pub fn id(self) -> &'static str {
        self.info().id
    }

    /// Whether the actuators run it; others change the robot itself.
    pub fn runs(self) -> bool {
        self.info().site == Site::Joint && self.info().place == Place::Table
    }
}

/// From zero to `upper`.
pub(super) const fn positive(upper: f64) -> Bounds {
    Bounds { lower: 0.0, upper }
}

/// From `-limit` to `limit`.
pub(super) const fn signed(limit: f64) -> Bounds {
    Bounds {
        lower: -limit,
        upper: limit,
    }
}
