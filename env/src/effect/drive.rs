//! Motor and supply: torque limit, torque-speed line, rotor inertia, supply voltage.

use super::catalogue::{Bounds, Info, Parameter, Place, Scale, Site, positive};

pub(super) const TORQUE_LIMIT: Info = Info {
    id: "torque_limit",
    site: Site::Joint,
    place: Place::Joint("torque_limit"),
    parameters: &[Parameter {
        name: "torque",
        scale: Scale::Torque,
        neutral: None,
        starts: &[0.9, 0.6],
        bounds: positive(1e9),
        default: None,
        what: "largest torque at standstill",
    }],
    what: "the motor's torque is bounded",
};

pub(super) const SPEED_TORQUE_CURVE: Info = Info {
    id: "speed_torque_curve",
    site: Site::Joint,
    place: Place::Joint("speed_limit"),
    parameters: &[Parameter {
        name: "no_load_speed",
        scale: Scale::Speed,
        neutral: None,
        starts: &[1.2, 0.8],
        bounds: positive(1e9),
        default: None,
        what: "speed at which no torque is left",
    }],
    what: "the largest torque falls linearly with speed",
};

pub(super) const SUPPLY_VOLTAGE: Info = Info {
    id: "supply_voltage",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[
        Parameter {
            name: "actual",
            scale: Scale::Voltage,
            neutral: Some(1.0),
            starts: &[0.9, 0.8],
            bounds: positive(1e5),
            default: None,
            what: "voltage at the motor",
        },
        Parameter {
            name: "nominal",
            scale: Scale::Voltage,
            neutral: None,
            starts: &[],
            bounds: Bounds {
                lower: 1e-3,
                upper: 1e5,
            },
            default: Some(1.0),
            what: "voltage at which gains and limits hold",
        },
    ],
    what: "stiffness, torque and no-load speed go with the voltage at the motor",
};

pub(super) const ARMATURE: Info = Info {
    id: "armature",
    site: Site::Joint,
    place: Place::Joint("armature"),
    parameters: &[Parameter {
        name: "inertia",
        scale: Scale::Inertia,
        neutral: Some(0.0),
        starts: &[0.2, 1.0],
        bounds: positive(1e9),
        default: None,
        what: "inertia of the rotor at the joint",
    }],
    what: "the rotor's inertia, multiplied by the gear ratio squared",
};
